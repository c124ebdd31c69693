import numpy as np
import pytest
import skimage.data

from dfdbench.simulation.photographs import GAMMA, near_normal_numbers, photograph


def test_a_photograph_is_linear_light() -> None:
    light = photograph("coffee")
    encoded = skimage.data.coffee()  # type: ignore[no-untyped-call]
    assert light.shape == encoded.shape
    assert light.min() >= 0
    assert light.max() <= 1
    assert np.array_equal(np.rint(255 * light ** (1 / GAMMA)), encoded)


def test_noise_is_the_same_in_every_version_of_numpy() -> None:
    # The demo set is made of them: other numbers would be another data set.
    expected = [1.66322969718344, -1.09368479197936, -0.03197908748478, -0.44020138937722]
    assert near_normal_numbers((4,), (7, 1)) == pytest.approx(expected, abs=1e-9)
    first, other = near_normal_numbers((6,), (1,)), near_normal_numbers((6,), (2,))
    assert np.array_equal(near_normal_numbers((2, 3), (1,)), first.reshape(2, 3))
    assert not np.array_equal(first, other)
