from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.errors import SourceError
from dfdbench.optics.lens_table import read_lens_table
from dfdbench.rig import registration
from dfdbench.rig.geometry import CaptureRig, Pose
from dfdbench.rig.lidar import average_scans, depth_image, read_beams, warp
from dfdbench.rig.sighting import Sighting, board_rays
from dfdbench.simulation.board_scene import MOUNTED, SimulatedScene, defocus
from dfdbench.simulation.raycast import View

PLACES = np.array([[[10.0, 10], [620, 10], [620, 620], [10, 620], [315, 315]]])
OTHER = Pose(-0.8, 0.6, 1.2)
# Its rows run along the upper and lower side of a flat board: the height falls between two beams.
LEVEL = Pose(0.254, 0.734, 0.0)
RIG = CaptureRig()


@cache
def seen(number: int) -> tuple[View, np.ndarray]:
    scene = SimulatedScene(number)
    view = scene.look()
    return view, scene.frame(defocus(view, read_lens_table(), 135), 40, (135, 40, 0))


@cache
def scanned(number: int, pose: Pose) -> np.ndarray:
    scene = SimulatedScene(number, pose=pose)
    return average_scans([scene.scan(read_beams(), n) for n in range(5)])


@cache
def sighted(number: int, pose: Pose) -> Sighting:
    return registration.sight(seen(number)[1], scanned(number, pose), read_beams(), RIG)


def unseen(number: int, pose: Pose) -> Sighting:
    """A board that fills the frame: the image shows none of its sides."""
    return Sighting(board_rays(scanned(number, pose), read_beams()), [])


def shift(found: registration.Registration, sighting: Sighting, pose: Pose) -> float:
    """How far apart found and true transform put corners and middle of the image, in pixels."""
    source = cv2.perspectiveTransform(PLACES, np.linalg.inv(sighting.rays.matrix(pose, RIG)))
    moved = cv2.perspectiveTransform(source, found.matrix)
    return float(np.linalg.norm(moved - PLACES, axis=-1).max())


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 3, 32, 50])
@pytest.mark.parametrize("pose", [MOUNTED, OTHER])
def test_a_known_misalignment_is_recovered_within_three_pixels(number: int, pose: Pose) -> None:
    view, _ = seen(number)
    sighting = sighted(number, pose)
    found = registration.register({"k": sighting}, RIG)[0]["k"]
    parallel = sighting.rays.matrix(Pose(), RIG)
    assert shift(registration.Registration(parallel, Pose(), None, 0.0, 0), sighting, pose) > 15
    assert shift(found, sighting, pose) < 3
    assert (found.agreement or 0) > 0.98
    # And so is the distance that lay before the rig, to two levels on 95 % of what is valid.
    image = depth_image(scanned(number, pose), read_beams())
    levels, valid = warp(*image, found.matrix, (630, 630))
    expected = SimulatedScene(number).truth(view).astype(int) // 10
    assert valid.mean() > 0.95
    assert (np.abs(levels.astype(int) - expected) <= 2)[valid].mean() > 0.95


@pytest.mark.slow
def test_what_one_board_leaves_open_is_told_and_others_of_the_rig_settle_it() -> None:
    flat, oblique = sighted(3, LEVEL), sighted(1, LEVEL)
    alone = registration.register({"k03": flat}, RIG)[0]["k03"]
    assert alone.known_to > 3
    assert shift(alone, flat, LEVEL) < alone.known_to + 1
    together, problems = registration.register({"k03": flat, "k01": oblique}, RIG)
    assert (problems, together["k03"].boards) == ({}, 2)
    assert together["k03"].pose == together["k01"].pose
    assert together["k03"].known_to < 1.5
    assert max(shift(together["k03"], flat, LEVEL), shift(together["k01"], oblique, LEVEL)) < 1.5


@pytest.mark.slow
def test_an_image_that_shows_no_sides_is_registered_by_others_of_the_rig() -> None:
    filled = unseen(3, MOUNTED)
    found, problems = registration.register({"k01": sighted(1, MOUNTED), "k03": filled}, RIG)
    assert problems == {}
    assert found["k03"].agreement is None
    assert shift(found["k03"], filled, MOUNTED) < 3
    _, problems = registration.register({"k03": filled}, RIG)
    assert "of the board's sides are found" in str(problems["k03"][0])


@pytest.mark.slow
def test_a_scene_of_another_rig_is_registered_by_itself_and_spoils_nothing() -> None:
    scenes = {"k01": (1, MOUNTED), "k03": (3, MOUNTED), "k50": (50, OTHER)}
    sightings = {name: sighted(*scene) for name, scene in scenes.items()}
    found, problems = registration.register(sightings, RIG)
    assert problems == {}
    assert [found[name].boards for name in scenes] == [2, 2, 1]
    for name, (_, pose) in scenes.items():
        assert shift(found[name], sightings[name], pose) < 3


CORNERS = np.array([[500.0, 300], [1200, 300], [1200, 1000], [500, 1000]])
MATRIX = np.array([[0.97, 0.02, -500.0], [-0.01, 1.02, -310.0], [1e-5, -2e-5, 1.0]])


def test_what_is_written_is_read_and_may_be_edited(tmp_path: Path) -> None:
    path = tmp_path / "registration.toml"
    registration.write_registration(path, MATRIX, CORNERS, "by hand")
    assert registration.read_registration(path) == pytest.approx(MATRIX, rel=2e-3, abs=2e-6)
    assert "# by hand" in path.read_text()
    # A person may move a point, or give the matrix outright.
    shift = np.array([[1.0, 0, 5], [0, 1, -7], [0, 0, 1]])
    registration.write_registration(path, shift, CORNERS, "")
    path.write_text(path.read_text().replace("image = [505.00, 293.00]", "image = [525.00, 293]"))
    moved = registration.read_registration(path) @ np.array([500.0, 300, 1])
    assert moved[:2] / moved[2] == pytest.approx([525, 293])
    path.write_text(f"matrix = {MATRIX.tolist()}\n")
    assert (registration.read_registration(path) == MATRIX).all()


def test_a_file_that_gives_no_transform_is_told(tmp_path: Path) -> None:
    path = tmp_path / "registration.toml"
    for text, said in (
        ("", "too few pairs"),
        ("matrix = [[0, 0, 0], [0, 0, 0], [0, 0, 0]]", "not a projective matrix"),
        ("[[pairs]]\nlidar = [1, 2]\nimage = [1]\n" * 4, "field is missing"),
        ("[[pairs]]\nlidar = [1, 2]\nimage = [1, 2]\n" * 4, "share a point"),
        ("pairs = ", "cannot read"),
    ):
        path.write_text(text)
        with pytest.raises(SourceError, match=said):
            registration.read_registration(path)
    with pytest.raises(SourceError, match="cannot read"):
        registration.read_registration(tmp_path / "none.toml")
