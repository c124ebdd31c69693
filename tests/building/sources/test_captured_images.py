from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.blur.formation import focus_levels, form_stack
from dfdbench.blur.recipe import RECIPES
from dfdbench.building.sources.captured_images import (
    CapturedImages,
    captured_images,
    depth_of,
    misordered,
)
from dfdbench.datasets.captured_files import CapturedFiles
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Depth
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import SourceError
from tests.made_folder import FOLDER_TOML, MOVED, SHAPE, write_scene

NAMES = ("sharp.png", "blurred.png", "depth.png")
DEPTH: Depth = parse_manifest(FOLDER_TOML.encode(), "mine-1.toml").depth


def files(**fields: object) -> CapturedFiles:
    usual = {"infocus": "a", "defocus": "b", "depth": "c", "depth_unit": 0.001}
    return CapturedFiles.model_validate(usual | fields)


def made(folder: Path, **fields: object) -> CapturedImages:
    *photographs, depth = [((folder / name).read_bytes(), name) for name in NAMES]
    return captured_images(photographs, depth, files(**fields), DEPTH)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    write_scene(tmp_path, 0)
    return tmp_path


def difference(pair: CapturedImages) -> float:
    inner = (slice(8, -8), slice(8, -8))
    sharp = cv2.GaussianBlur(pair.images[0], (0, 0), 1.5).astype(float)
    return float(np.abs(sharp - pair.images[1])[inner].mean())


def test_a_pair_is_left_as_it_is_unless_it_is_asked_for(scene: Path) -> None:
    pair = made(scene)
    assert pair.images.shape == (2, *SHAPE, 3)
    for image, name in zip(pair.images, NAMES, strict=False):
        np.testing.assert_array_equal(image[..., ::-1], cv2.imread(str(scene / name)))
    assert (pair.found, pair.warnings) == (({},), ())
    assert np.isnan(pair.depth[:, :2]).all()
    assert np.isfinite(pair.depth[:, 2:]).all()


def test_alignment_and_gain_undo_what_the_camera_did(scene: Path) -> None:
    before, after = made(scene), made(scene, align="euclidean", match_gain=True)
    assert difference(before) > 10
    assert difference(after) < 2
    assert after.found[0]["right"] == pytest.approx(-MOVED[0], abs=0.1)
    assert after.found[0]["down"] == pytest.approx(-MOVED[1], abs=0.1)
    assert after.found[0]["gain"] == pytest.approx(1 / 0.9, abs=0.01)
    # What the moved image does not reach has no blur to be told by.
    assert np.isnan(after.depth[:, -2:]).all()
    np.testing.assert_array_equal(after.images[0], before.images[0])
    after = made(scene, align="translation", moved="infocus")
    np.testing.assert_array_equal(after.images[1], before.images[1])
    assert after.found[0]["right"] == pytest.approx(MOVED[0], abs=0.1)


def test_a_crop_is_the_same_of_all(scene: Path) -> None:
    whole, part = made(scene), made(scene, crop={"x": 10, "y": 5, "width": 40, "height": 30})
    for of, kept in ((whole.images[1], part.images[1]), (whole.depth, part.depth)):
        np.testing.assert_array_equal(of[5:35, 10:50], kept)
    with pytest.raises(SourceError, match="the crop reaches to"):
        made(scene, crop={"x": 60, "y": 0, "width": 40, "height": 30})


def test_all_that_is_wrong_is_told_at_once(scene: Path) -> None:
    (scene / "blurred.png").write_bytes(b"")
    cv2.imwrite(str(scene / "depth.png"), np.full((36, 48), 2, np.uint16))
    with pytest.raises(SourceError) as caught:
        made(scene)
    said = [(problem.what, problem.where) for problem in caught.value.problems]
    assert said == [
        ("not an image file", "blurred.png"),
        ("a median of 0.002 m, not 0.5 to 5 m: another unit, or other bounds", "depth.png"),
        ("size differs", "depth.png"),
    ]


SCALE = DepthScale(near=0.5, far=5.0)
INVERSE = Depth(axes=[], unknown=0, grows_with="nearness", unit="", scale=SCALE)


def test_metres_become_levels_and_what_is_missing_or_beyond_is_unknown() -> None:
    values = np.array([[500, 1000, 5000, 0, 65535, 499, 5001]], np.uint16)
    levels = depth_of(values, files(depth_missing=[0, 65535]), INVERSE, "d.png")
    assert levels[0, :3].tolist() == [255, 114, 1]
    assert np.isnan(levels[0, 3:]).all()


def test_a_file_with_fractions_keeps_them_in_levels_and_in_metres() -> None:
    values = np.array([[0.75, 1.0, 5.5, np.nan]], np.float32)
    (levels,) = depth_of(values, files(depth_unit=1.0), INVERSE, "d.npy").tolist()
    assert levels[:2] == pytest.approx([160.926, 113.889], abs=1e-3)
    # A fraction in the manifest is found in a file that rounds it to float32.
    told, values = files(depth_unit=1.0, depth_missing=[2.8]), np.array([[2.8, 3]], np.float32)
    assert np.isnan(depth_of(values, told, INVERSE, "d.npy")).tolist() == [[True, False]]
    values = np.array([[0.75, 1.0, 5.5, np.nan]], np.float32)
    metres = INVERSE.model_copy(update={"unit": "metres"})
    found = depth_of(values, files(depth_unit=None), metres, "d.npy")
    np.testing.assert_array_equal(found, np.array([[0.75, 1, np.nan, np.nan]], np.float32))


def test_whole_numbers_are_no_metres_unless_a_unit_says_so() -> None:
    metres = INVERSE.model_copy(update={"unit": "metres"})
    values = np.full((2, 2), 2000, np.uint16)
    with pytest.raises(SourceError, match="whole numbers, and not metres") as caught:
        depth_of(values, files(depth_unit=None), metres, "d.png")
    assert caught.value.problems[0].fix == "depth_unit = 0.001 (millimetres) would fit"
    assert depth_of(values, files(), metres, "d.png").tolist() == [[2, 2], [2, 2]]


def test_another_unit_is_linear_in_levels_between_two_values() -> None:
    disparity = np.array([[2.5, 0, -1.5, 2.6]], np.float32)
    about = files(depth_unit=None, depth_ends=[2.5, -1.5], depth_missing=[])
    plain = INVERSE.model_copy(update={"scale": None})
    levels = depth_of(disparity, about, plain, "d.npy")
    np.testing.assert_allclose(levels, [[255, 96.25, 1, np.nan]])
    farther = plain.model_copy(update={"grows_with": "distance"})
    levels = depth_of(disparity, about, farther, "d.npy")
    np.testing.assert_allclose(levels, [[1, 159.75, 255, np.nan]])


def test_another_unit_is_told_with_the_one_that_fits() -> None:
    values = np.full((2, 2), 2000.0)
    fixes = {1.0: "depth_unit = 0.001 (millimetres)", 0.01: "0.001 (millimetres)", 1e-5: "0.001"}
    for unit, fix in fixes.items():
        with pytest.raises(SourceError, match="another unit") as caught:
            depth_of(values, files(depth_unit=unit), INVERSE, "d.png")
        assert fix in caught.value.problems[0].fix
        with pytest.raises(SourceError, match=r"another unit[^$]*Fix: .*mend near and far"):
            depth_of(values * 1e9, files(depth_unit=unit), INVERSE, "d.png")


def test_files_may_hold_levels() -> None:
    plain = INVERSE.model_copy(update={"scale": None})
    values = np.array([[0, 7, 255, 9]], float)
    levels = depth_of(values, files(depth_unit=None, depth_missing=[9]), plain, "d.png")
    np.testing.assert_array_equal(levels, [[np.nan, 7, 255, np.nan]])
    for wrong in (256.0, 1.5, -1.0):
        with pytest.raises(SourceError, match="no depth levels"):
            depth_of(np.array([[wrong, 3]]), files(depth_unit=None), plain, "d.png")


@pytest.mark.parametrize("in_metres", [True, False])
def test_a_stack_in_the_wrong_order_is_warned_of(in_metres: bool) -> None:
    levels = np.tile(np.linspace(0, 255, 120).astype(np.uint8), (90, 1))
    noise = np.random.default_rng(0).integers(0, 256, (90, 120, 3)).astype(np.uint8)
    stack = form_stack(noise, levels, RECIPES["published"], 5)
    depth = 600 - levels.astype(np.float32) if in_metres else levels.astype(np.float32)
    found = CapturedImages(stack, depth, (), ())
    told = [{"focus_depth": np.nan, "focus_distance": 600.0 - f} for f in focus_levels(5)]
    assert misordered("desk", found, told, in_metres) == ()
    unknown = [{"focus_depth": np.nan, "focus_distance": np.nan}] * 3
    assert misordered("desk", found, [*told[:2:-1], *unknown], in_metres) == ()
    (warning,) = misordered("desk", found, told[::-1], in_metres)
    assert warning.startswith("desk: the images are sharp where depth says they are not")
