from pathlib import Path

import numpy as np
import pytest

from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Recording
from dfdbench.errors import InputError, ResultError
from dfdbench.optics.lens_table import read_lens_table
from dfdbench.rig.geometry import Pose
from dfdbench.rig.lidar import read_beams
from dfdbench.rig.registration import read_registration
from dfdbench.simulation.board_scene import CaptureSettings, SimulatedScene, defocus, write_captures
from dfdbench.simulation.raycast import View
from dfdbench.system.files import writing_folder

MID_GREY = np.full((200, 200, 3), 0.5)


def levels(scene: SimulatedScene, exposure: int, seed: tuple[int, ...]) -> np.ndarray:
    # White fills the sensor at 55 ms: a half is mid grey there.
    return scene.frame(MID_GREY, exposure, seed).astype(float)


def test_a_frame_has_the_cameras_noise_and_its_own_is_linear_and_saturates() -> None:
    scene = SimulatedScene(0)
    frame = levels(scene, 55, (1,))
    assert frame.mean() == pytest.approx(127.5, abs=1)
    assert frame.std() == pytest.approx(3.1, abs=0.1)
    assert (frame != levels(scene, 55, (2,))).any()
    assert levels(scene, 10, (1,)).mean() == pytest.approx(127.5 * 10 / 55, abs=1)
    assert (scene.frame(np.full((9, 9, 3), 2.0), 70, (1,)) == 255).all()


def test_a_scan_sees_the_board_at_its_distance_and_loses_returns() -> None:
    beams = read_beams()
    scene = SimulatedScene(3, pose=Pose())
    ranges = scene.scan(beams, 0)
    assert (ranges != scene.scan(beams, 1)).any()
    ahead = ranges[28:36, 1000:1040]
    assert np.median(ahead[ahead > 0]) == pytest.approx(1500, abs=10)
    assert np.abs(ahead[ahead > 0] - 1505).max() < 100
    assert 0.01 < (ranges == 0).mean() < 0.03
    # The mirror on the board never returns anything.
    averaged = np.mean([SimulatedScene(3).scan(beams, n) for n in range(5)], axis=0)
    assert (averaged == 0).sum() > 10


def test_the_blur_follows_the_lens_table() -> None:
    table = read_lens_table()
    point = np.zeros((41, 41, 3))
    point[20, 20] = 1.0
    near, far = (View(np.full((41, 41), d), np.zeros(point.shape), point) for d in (1.5, 2.2))
    reach = {}
    for step, view, distance in ((141, near, 1.5), (141, far, 2.2), (135, near, 1.5)):
        spread = defocus(view, table, step)[..., 0]
        assert spread.sum() == pytest.approx(1, abs=1e-5)
        lit = np.flatnonzero(spread[20] > 1e-4)
        reach[step, distance] = (lit[-1] - lit[0]) / 2
    assert reach == {(141, 1.5): 7, (141, 2.2): 9, (135, 1.5): 1}


FEW = CaptureSettings(steps=(135,), exposures=(30,), frames=1, scans=2)


@pytest.fixture(scope="module")
def capture() -> Recording:
    found = find_manifest("realworld").capture
    assert found is not None
    # A sixteenth of the pixels: what is tested does not depend on them.
    return found.model_copy(update={"frame_size": (182, 184), "crop_size": 157})


def test_captures_are_the_same_again_and_a_stopped_one_goes_on(
    capture: Recording, tmp_path: Path
) -> None:
    first, second = tmp_path / "a", tmp_path / "b"
    assert write_captures(first, ("k03", "k05"), capture, FEW, workers=2) == ("k03", "k05")
    assert write_captures(second, ("k05",), capture, FEW) == ("k05",)
    assert write_captures(second, ("k03", "k05"), capture, FEW) == ("k03",)
    files = sorted(path.relative_to(first) for path in first.rglob("*") if path.is_file())
    assert Path("k05/frames/exp_30/image_135_30.00_0.png") in files
    for path in files:
        assert (first / path).read_bytes() == (second / path).read_bytes(), path
    second_writer = pytest.raises(ResultError, match="another simulation is writing this folder")
    with writing_folder(first, "simulation"), second_writer:
        write_captures(first, ("k03", "k05"), capture, FEW)
    assert read_registration(first / "truth/k03/registration.toml").shape == (3, 3)


def test_what_is_not_ours_is_left_alone(capture: Recording, tmp_path: Path) -> None:
    (tmp_path / "k03").mkdir()
    (tmp_path / "k03/holiday.jpg").write_bytes(b"mine")
    with pytest.raises(InputError, match="captures of another kind"):
        write_captures(tmp_path, ("k03",), capture, FEW)
    assert [path.name for path in (tmp_path / "k03").iterdir()] == ["holiday.jpg"]
    (tmp_path / "k03/simulated.json").write_text("{}")
    with pytest.raises(InputError, match="other settings"):
        write_captures(tmp_path, ("k03",), capture, FEW)
