import numpy as np
import pytest

from dfdbench.datasets.captures import LEVELS
from dfdbench.datasets.depth_scale import DepthScale


@pytest.mark.parametrize("law", ["inverse", "linear"])
def test_levels_turn_into_metres_and_back(law: str) -> None:
    scale = DepthScale.model_validate({"law": law, "near": 0.5, "far": 8.0})
    levels = np.arange(1, 256)
    metres = scale.to_metres(levels)
    assert (metres[0], metres[-1]) == (pytest.approx(8.0), pytest.approx(0.5))
    assert (np.diff(metres) < 0).all()
    np.testing.assert_array_equal(scale.to_levels(metres), levels)


def test_inverse_halves_the_way_in_inverse_depth() -> None:
    scale = DepthScale(law="inverse", near=1.0, far=3.0, near_level=201, far_level=1)
    assert scale.to_metres(np.array([101.0])) == pytest.approx(1 / (0.5 * (1 + 1 / 3)))
    linear = DepthScale(law="linear", near=1.0, far=3.0, near_level=201, far_level=1)
    assert linear.to_metres(np.array([101.0])) == pytest.approx(2.0)


def test_what_lies_beyond_counts_as_the_end_and_what_is_no_distance_is_unknown() -> None:
    scale = DepthScale(law="inverse", near=1.0, far=4.0, near_level=0, far_level=254)
    metres = np.array([0.1, 100.0, 0.0, -1.0, np.nan, np.inf])
    assert scale.to_levels(metres, unknown=255).tolist() == [0, 254, 255, 255, 255, 255]
    about = LEVELS.model_copy(update={"scale": scale})
    assert about.of_unit(metres[:2].astype(np.float32), "metres").tolist() == [0, 254]
    assert scale.to_metres(np.array([-20.0, 0.0, 254.0, 300.0])).tolist() == [1.0, 1.0, 4.0, 4.0]
