from pathlib import Path

import numpy as np
import pytest

from dfdbench.errors import SourceError
from dfdbench.optics.white_dot import read_lens_captures, without_dot
from dfdbench.simulation.white_dot import write_lens_test
from tests.conftest import write_png


def test_a_lens_test_shows_warming_and_hysteresis(tmp_path: Path) -> None:
    assert write_lens_test(tmp_path) == 12 + 2 * 17
    found = read_lens_captures(tmp_path)
    warm = found["temperature"]
    assert [m.temperature for m in warm] == sorted(m.temperature for m in warm)
    assert warm[-1].sharpness > 1.5 * warm[0].sharpness
    # The noise grows as well, and does not explain all of it.
    assert warm[-1].background > warm[0].background
    assert all(m.background < m.sharpness for m in warm)
    steps = [m.step for m in found["up"]]
    assert steps == list(range(127, 144)) == [m.step for m in found["down"]]
    gap = {
        u.step: u.sharpness - d.sharpness for u, d in zip(found["up"], found["down"], strict=True)
    }
    assert gap[133] < -0.01 < 0.01 < gap[138]


def test_only_the_dot_is_replaced() -> None:
    image = np.random.default_rng(0).integers(10, 14, (64, 64)).astype(np.uint8)
    dotted = image.copy()
    dotted[30:34, 30:34] = 240
    cleaned = without_dot(dotted)
    far = np.ones(image.shape, bool)
    far[25:39, 25:39] = False
    assert (cleaned[far] == image[far]).all()
    assert cleaned.max() < 14


def test_files_that_cannot_be_used_are_all_told(tmp_path: Path) -> None:
    dot = np.zeros((32, 32, 3), np.uint8)
    dot[14:18, 14:18] = 200
    write_png(tmp_path / "temperature/image_135_40.00.png", dot)
    write_png(tmp_path / "up/dot.png", dot)
    write_png(tmp_path / "up/image_127_30.00.png", np.zeros((32, 32, 3), np.uint8))
    (tmp_path / "up/image_128_30.00.png").write_bytes(b"no image")
    with pytest.raises(SourceError) as told:
        read_lens_captures(tmp_path)
    assert [problem.what for problem in told.value.problems] == [
        "name tells no voltage step",
        "name tells no voltage step",
        "no dot in the image",
        "not an image",
    ]
    with pytest.raises(SourceError, match="simulate lens"):
        read_lens_captures(tmp_path / "none")
