import numpy as np
import pytest

from dfdbench.building.sources.depth_values import depth_of
from dfdbench.datasets.captured_files import CapturedFiles
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Depth
from dfdbench.errors import SourceError

SCALE = DepthScale(near=0.5, far=5.0)
DEPTH = Depth(axes=[], unknown=0, grows_with="nearness", unit="", scale=SCALE)


def files(**fields: object) -> CapturedFiles:
    return CapturedFiles.model_validate(
        {"infocus": "a", "defocus": "b", "depth": "c", "depth_unit": 0.001, **fields}
    )


def test_metres_become_levels_and_what_is_missing_or_beyond_is_unknown() -> None:
    values = np.array([[500, 1000, 5000, 0, 65535, 499, 5001]], np.uint16)
    levels = depth_of(values, files(depth_missing=[0, 65535]), DEPTH, "d.png")
    assert levels[0, :3].tolist() == [255, 114, 1]
    assert np.isnan(levels[0, 3:]).all()


def test_a_file_with_fractions_keeps_them_in_levels_and_in_metres() -> None:
    values = np.array([[0.75, 1.0, 5.5, np.nan]], np.float32)
    (levels,) = depth_of(values, files(depth_unit=1.0), DEPTH, "d.npy").tolist()
    assert levels[:2] == pytest.approx([160.926, 113.889], abs=1e-3)
    metres = DEPTH.model_copy(update={"unit": "metres"})
    found = depth_of(values, files(depth_unit=None), metres, "d.npy")
    np.testing.assert_array_equal(found, np.array([[0.75, 1, np.nan, np.nan]], np.float32))


def test_whole_numbers_are_no_metres_unless_a_unit_says_so() -> None:
    metres = DEPTH.model_copy(update={"unit": "metres"})
    values = np.full((2, 2), 2000, np.uint16)
    with pytest.raises(SourceError, match="whole numbers, and not metres") as caught:
        depth_of(values, files(depth_unit=None), metres, "d.png")
    assert caught.value.problems[0].fix == "depth_unit = 0.001 (millimetres) would fit"
    assert depth_of(values, files(), metres, "d.png").tolist() == [[2, 2], [2, 2]]


def test_another_unit_is_linear_in_levels_between_two_values() -> None:
    disparity = np.array([[2.5, 0, -1.5, 2.6]], np.float32)
    about = files(depth_unit=None, depth_ends=[2.5, -1.5], depth_missing=[])
    plain = DEPTH.model_copy(update={"scale": None})
    levels = depth_of(disparity, about, plain, "d.npy")
    np.testing.assert_allclose(levels, [[255, 96.25, 1, np.nan]])
    farther = plain.model_copy(update={"grows_with": "distance"})
    np.testing.assert_allclose(
        depth_of(disparity, about, farther, "d.npy"), [[1, 159.75, 255, np.nan]]
    )


@pytest.mark.parametrize(
    ("unit", "fix"),
    [(1.0, "depth_unit = 0.001 (millimetres)"), (0.01, "0.001 (millimetres)"), (0.00001, "0.001")],
)
def test_another_unit_is_told_with_the_one_that_fits(unit: float, fix: str) -> None:
    values = np.full((2, 2), 2000.0)
    with pytest.raises(SourceError, match="another unit") as caught:
        depth_of(values, files(depth_unit=unit), DEPTH, "d.png")
    assert fix in caught.value.problems[0].fix
    with pytest.raises(SourceError, match="another unit") as caught:
        depth_of(values * 1e9, files(depth_unit=unit), DEPTH, "d.png")
    assert "mend near and far" in caught.value.problems[0].fix


def test_a_scene_just_beyond_the_bounds_asks_for_wider_ones() -> None:
    with pytest.raises(SourceError, match="or other bounds") as caught:
        depth_of(np.full((2, 2), 400.0), files(), DEPTH, "d.png")
    assert caught.value.problems[0].fix == "widen near and far under [depth.scale]"


def test_files_may_hold_levels() -> None:
    plain = DEPTH.model_copy(update={"scale": None})
    values = np.array([[0, 7, 255, 9]], float)
    levels = depth_of(values, files(depth_unit=None, depth_missing=[9]), plain, "d.png")
    np.testing.assert_array_equal(levels, [[np.nan, 7, 255, np.nan]])
    for wrong in (256.0, 1.5, -1.0):
        with pytest.raises(SourceError, match="no depth levels"):
            depth_of(np.array([[wrong, 3]]), files(depth_unit=None), plain, "d.png")


def test_a_map_without_depth_is_refused() -> None:
    with pytest.raises(SourceError, match=r"none of 2 depths .*above 0"):
        depth_of(np.array([[0, np.nan]]), files(), DEPTH, "d.png")
