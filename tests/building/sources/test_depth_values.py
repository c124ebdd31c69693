import numpy as np
import pytest

from dfdbench.building.sources.depth_values import depth_levels
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
    values = np.array([[500, 1000, 5000, 0, 65535, 499, 5001]], float)
    levels, known = depth_levels(values, files(depth_missing=[0, 65535]), DEPTH, "d.png")
    assert levels.tolist() == [[255, 114, 1, 0, 0, 0, 0]]
    assert known.tolist() == [[True, True, True, False, False, False, False]]


@pytest.mark.parametrize(
    ("unit", "fix"),
    [(1.0, "depth_unit = 0.001 (millimetres)"), (0.01, "0.001 (millimetres)"), (0.00001, "0.001")],
)
def test_another_unit_is_told_with_the_one_that_fits(unit: float, fix: str) -> None:
    values = np.full((2, 2), 2000.0)
    with pytest.raises(SourceError, match="another unit") as caught:
        depth_levels(values, files(depth_unit=unit), DEPTH, "d.png")
    assert fix in caught.value.problems[0].fix
    with pytest.raises(SourceError, match="another unit") as caught:
        depth_levels(values * 1e9, files(depth_unit=unit), DEPTH, "d.png")
    assert "mend near and far" in caught.value.problems[0].fix


def test_a_scene_just_beyond_the_bounds_asks_for_wider_ones() -> None:
    with pytest.raises(SourceError, match="or other bounds") as caught:
        depth_levels(np.full((2, 2), 400.0), files(), DEPTH, "d.png")
    assert caught.value.problems[0].fix == "widen near and far under [depth.scale]"


def test_files_may_hold_levels() -> None:
    plain = DEPTH.model_copy(update={"scale": None})
    values = np.array([[0, 7, 255, 9]], float)
    levels, known = depth_levels(values, files(depth_unit=None, depth_missing=[9]), plain, "d.png")
    assert levels.tolist() == [[0, 7, 255, 0]]
    assert known.tolist() == [[False, True, True, False]]
    for wrong in (256.0, 1.5, -1.0):
        with pytest.raises(SourceError, match="no depth levels"):
            depth_levels(np.array([[wrong, 3]]), files(depth_unit=None), plain, "d.png")


def test_a_map_without_depth_is_refused() -> None:
    with pytest.raises(SourceError, match=r"(?s)tells no depths.*above 0.*none of 2"):
        depth_levels(np.array([[0, np.nan]]), files(), DEPTH, "d.png")
