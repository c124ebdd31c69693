import numpy as np
import pytest
import skimage.data

from dfdbench.errors import SourceError
from dfdbench.simulation.photographs import GAMMA, near_normal_numbers, photograph


def test_a_photograph_is_linear_light() -> None:
    light = photograph("coffee")
    encoded = skimage.data.coffee()  # type: ignore[no-untyped-call]
    assert light.shape == encoded.shape
    assert light.min() >= 0
    assert light.max() <= 1
    assert np.array_equal(np.rint(255 * light ** (1 / GAMMA)), encoded)


def test_a_photograph_that_is_not_shipped_is_told() -> None:
    with pytest.raises(SourceError, match="a photograph of scikit-image is missing") as caught:
        photograph("nobody")
    assert "nobody.png" in caught.value.problems[0].where


def test_noise_is_the_same_in_every_version_of_numpy() -> None:
    # The demo set is made of them: other numbers would be another data set.
    expected = [1.66322969718344, -1.09368479197936, -0.03197908748478, -0.44020138937722]
    assert near_normal_numbers((4,), (7, 1)) == pytest.approx(expected, abs=1e-9)
    assert np.array_equal(
        near_normal_numbers((2, 3), (1,)), near_normal_numbers((6,), (1,)).reshape(2, 3)
    )
    assert not np.array_equal(near_normal_numbers((6,), (1,)), near_normal_numbers((6,), (2,)))


def test_noise_is_close_to_normal() -> None:
    numbers = near_normal_numbers((200_000,), (3,))
    assert numbers.mean() == pytest.approx(0, abs=0.01)
    assert numbers.std() == pytest.approx(1, abs=0.01)
    assert np.mean(np.abs(numbers) < 1) == pytest.approx(0.68, abs=0.02)
    assert np.mean(np.abs(numbers) < 2) == pytest.approx(0.95, abs=0.02)
