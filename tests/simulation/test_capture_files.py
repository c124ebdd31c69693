from pathlib import Path

import pytest

from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Recording
from dfdbench.errors import InputError
from dfdbench.rig.registration import read_registration
from dfdbench.simulation.capture_files import CaptureSettings, write_captures, write_lens_test

FEW = CaptureSettings(steps=(135,), exposures=(30,), frames=1, scans=2)


@pytest.fixture(scope="module")
def capture() -> Recording:
    found = find_manifest("realworld").capture
    assert found is not None
    # A quarter of the pixels: what is tested does not depend on them.
    return found.model_copy(update={"frame_size": (364, 368), "crop_size": 315})


def test_captures_are_the_same_on_every_run_and_a_stopped_one_goes_on(
    capture: Recording, tmp_path: Path
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


def test_what_is_not_ours_is_left_alone(capture: Recording, tmp_path: Path) -> None:
    (tmp_path / "k03").mkdir()
    (tmp_path / "k03/holiday.jpg").write_bytes(b"mine")
    with pytest.raises(InputError, match="captures of another kind"):
        write_captures(tmp_path, ("k03",), capture, FEW)
    assert [path.name for path in (tmp_path / "k03").iterdir()] == ["holiday.jpg"]
    (tmp_path / "k03/simulated.json").write_text("{}")
    with pytest.raises(InputError, match="other settings"):
        write_captures(tmp_path, ("k03",), capture, FEW)


def test_a_lens_test_is_made_alike_every_time(tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert write_lens_test(tmp_path / name) == 46
    for path in (tmp_path / "a/up").iterdir():
        assert (tmp_path / "b/up" / path.name).read_bytes() == path.read_bytes()
