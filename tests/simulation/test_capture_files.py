from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Capture
from dfdbench.errors import InputError
from dfdbench.optics.lens_table import read_lens_table
from dfdbench.rig.registration_file import read_registration
from dfdbench.simulation.capture_files import CaptureSettings, write_captures, write_lens_test

FEW = CaptureSettings(steps=(135,), exposures=(30,), frames=1, scans=2)


@pytest.fixture(scope="module")
def capture() -> Capture:
    found = find_manifest("realworld").capture
    assert found is not None
    # A quarter of the pixels: what is tested does not depend on them.
    return found.model_copy(update={"frame_size": (364, 368), "crop_size": 315})


def test_captures_are_the_same_on_every_run_and_a_stopped_one_goes_on(
    capture: Capture, tmp_path: Path
) -> None:
    first, second = tmp_path / "a", tmp_path / "b"
    assert write_captures(first, ("k03", "k05"), capture, FEW, workers=2) == ("k03", "k05")
    assert write_captures(second, ("k05",), capture, FEW) == ("k05",)
    assert write_captures(second, ("k03", "k05"), capture, FEW) == ("k03",)
    files = sorted(path.relative_to(first) for path in first.rglob("*") if path.is_file())
    assert [str(path) for path in files if path.parts[0] == "k05"] == [
        "k05/frames/exp_30/image_135_30.00_0.png",
        "k05/lidar/lidar_rng_00000.bin",
        "k05/lidar/lidar_rng_00001.bin",
        "k05/simulated.json",
    ]
    for path in files:
        assert (first / path).read_bytes() == (second / path).read_bytes(), path
    assert read_registration(first / "truth/k03/registration.toml").shape == (3, 3)


def test_what_is_not_ours_is_left_alone(capture: Capture, tmp_path: Path) -> None:
    (tmp_path / "k03").mkdir()
    (tmp_path / "k03/holiday.jpg").write_bytes(b"mine")
    with pytest.raises(InputError, match="captures of another kind"):
        write_captures(tmp_path, ("k03",), capture, FEW)
    assert [path.name for path in (tmp_path / "k03").iterdir()] == ["holiday.jpg"]
    (tmp_path / "k03/simulated.json").write_text("{}")
    with pytest.raises(InputError, match="other settings"):
        write_captures(tmp_path, ("k03",), capture, FEW)


@pytest.fixture(scope="module")
def dots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dots")
    assert write_lens_test(folder) == 46
    return folder


def read(path: Path) -> NDArray[np.float64]:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return np.asarray(image, np.float64)


def width(path: Path) -> int:
    """How many pixels are clearly brighter than the background."""
    return int((read(path) > 30).sum())


def test_there_is_an_image_a_temperature_and_a_step_each_way(dots: Path) -> None:
    names = {folder.name: len(list(folder.glob("*.png"))) for folder in dots.iterdir()}
    assert names == {"temperature": 12, "up": 17, "down": 17}
    steps = sorted(int(path.name.split("_")[1]) for path in (dots / "up").iterdir())
    assert steps == list(read_lens_table().steps)


def test_a_cold_lens_blurs_more_and_its_noise_is_less(dots: Path) -> None:
    cold, warm = (
        dots / f"temperature/image_135_40.00_{degrees}.png" for degrees in ("27.25", "54.75")
    )
    assert width(cold) > width(warm)
    assert read(cold).max() < read(warm).max()
    noise = [read(path)[:20, :20].std() for path in (cold, warm)]
    assert noise[0] < 0.8 * noise[1]


def test_the_lens_trails_behind_the_voltage(dots: Path) -> None:
    # The blur of a step on the way up is that of a lower one, on the way down of a higher one.
    radii = [float(read_lens_table().radius_at(step, 1.0)) for step in read_lens_table().steps]
    sharpest = read_lens_table().steps[int(np.argmin(radii))]
    assert 127 < sharpest < 143
    before, after = sharpest - 4, sharpest + 4
    for step, wider, narrower in ((before, "up", "down"), (after, "down", "up")):
        name = f"image_{step}_30.00.png"
        assert read(dots / wider / name).max() <= read(dots / narrower / name).max()


def test_it_is_made_alike_every_time(dots: Path, tmp_path: Path) -> None:
    write_lens_test(tmp_path)
    for path in (dots / "up").iterdir():
        assert (tmp_path / "up" / path.name).read_bytes() == path.read_bytes()
