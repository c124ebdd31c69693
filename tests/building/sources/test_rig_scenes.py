"""A scene's files, raw or published: found by name alone, so that these are empty or noise."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from dfdbench.building.sources.rig_scenes import PublishedScene, RawScene, find_captured_scene
from dfdbench.datasets.catalog import find_manifest
from dfdbench.rig.registration import NAME as REGISTRATION
from tests.conftest import write_png
from tests.made_captures import raw_scene

CAPTURE = find_manifest("realworld").capture or pytest.fail("the rig captured it")


def touch(*paths: Path) -> None:
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def test_the_layout_is_told_by_the_folder_of_frames(tmp_path: Path) -> None:
    touch(tmp_path / "k00/frames/x", tmp_path / "k01/left/x", tmp_path / "k02")
    assert isinstance(find_captured_scene(tmp_path, "k00", CAPTURE), RawScene)
    assert isinstance(find_captured_scene(tmp_path, "k01", CAPTURE), PublishedScene)
    # A file is no scene.
    assert find_captured_scene(tmp_path, "k02", CAPTURE) is None
    assert find_captured_scene(tmp_path, "k03", CAPTURE) is None


def test_raw_files_are_found_by_exposure_step_and_number(tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    touch(*(frames / f"exp_10/image_{step}_10.00_{n}.png" for step in (129, 141) for n in (0, 1)))
    touch(frames / "exp_5/image_129_5.00_0.png", frames / "exp_x/image_129_10.00_0.png")
    touch(frames / "exp_10/image_thumb_10.00.png", frames / "exp_70")
    scene = RawScene(tmp_path, CAPTURE)
    # A file is no exposure; a folder without a number neither.
    assert scene.exposures() == (5, 10)
    assert scene.steps(10) == (129, 141)
    names = [path.name for path in scene.images(10, 141)]
    assert names == ["image_141_10.00_0.png", "image_141_10.00_1.png"]
    assert scene.images(10, 130) == scene.images(20, 141) == []


def test_frames_of_one_image_are_counted(tmp_path: Path) -> None:
    for number in range(CAPTURE.frames - 1):
        frame = np.zeros((*CAPTURE.frame_size, 3), np.uint8)
        write_png(tmp_path / f"frames/exp_10/image_129_10.00_{number}.png", frame)
    (problem,) = RawScene(tmp_path, CAPTURE).image_problems(10, 129)
    assert problem.what == f"only {CAPTURE.frames - 1} of {CAPTURE.frames} frames"
    assert problem.where.endswith("frames/exp_10/image_129_10.00_*.png")


def test_a_scenes_own_calibration_comes_before_its_folders(tmp_path: Path) -> None:
    scene = RawScene(tmp_path / "k00", CAPTURE)
    assert scene.beams_file() is None
    assert len(scene.beams().altitude) == 64
    touch(tmp_path / "beams.csv")
    assert scene.beams_file() == tmp_path / "beams.csv"
    touch(tmp_path / "k00/beams.csv")
    assert scene.beams_file() == tmp_path / "k00/beams.csv"
    assert scene.depth_files() == [tmp_path / "k00/beams.csv", tmp_path / "k00" / REGISTRATION]


def test_of_published_depth_maps_the_scaled_one_is_taken(tmp_path: Path) -> None:
    scene = PublishedScene(tmp_path, CAPTURE)
    (problem,) = scene.depth_problems()
    assert problem.what.startswith("scene has no LIDAR depth map")
    touch(tmp_path / "lidar/lidar_rng_left_00000_8bit.png")
    assert [path.name for path in scene.depth_files()] == ["lidar_rng_left_00000_8bit.png"]
    levels = np.full((630, 630), 90, np.uint8)
    levels[0, :3] = (0, 255, 254)
    write_png(tmp_path / "lidar/lidar_rng_left_00000_8bit_x6.png", levels)
    assert scene.depth_problems() == []
    found, valid = scene.depth()
    assert np.array_equal(found, levels)
    # 0 and 255 say that nothing came back.
    assert np.argwhere(~valid).tolist() == [[0, 0], [0, 1]]


@pytest.mark.parametrize("damage", ["lidar", "registration"])
def test_what_depth_lacks_is_told_with_what_to_do(
    captures: Path, tmp_path: Path, damage: str
) -> None:
    shutil.copytree(captures / "k03", tmp_path / "k03")
    if damage == "lidar":
        shutil.rmtree(tmp_path / "k03/lidar")
    else:
        (tmp_path / "k03" / REGISTRATION).unlink()
    (problem,) = raw_scene(tmp_path, "k03").depth_problems()
    if damage == "lidar":
        assert (problem.what, problem.where) == (
            "scene has no lidar/lidar_rng_00000.bin",
            str(tmp_path / "k03"),
        )
    else:
        assert problem.fix == f"dfdbench rig register k03 --source {tmp_path}"
