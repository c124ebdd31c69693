from pathlib import Path

import pytest

from tests.cli.command import Command

BLUR = "rig optics blur --f-number 3.7 --focal-length 9.6mm --focus 0.5m"


def test_blur_prints_a_table_and_draws_the_curve(dfdbench: Command) -> None:
    outcome = dfdbench.fine(f"{BLUR} --pixel 4.8um --range 40cm 4")
    assert "10.58 pixels" in outcome.out
    assert "0.4568 m to 0.5522 m" in outcome.out
    assert Path("blur.png").read_bytes().startswith(b"\x89PNG")


def test_pairs_ranks_the_lens_that_is_shipped_and_one_of_ones_own(dfdbench: Command) -> None:
    outcome = dfdbench("rig optics pairs --range 1.5 2.2")
    row = next(line for line in outcome.out.splitlines() if "141-129" in line)
    assert row.split() == ["3", "141-129", "1", "1", "2", "2", "3", "3", "3", "4", "4", "3", "3"]
    assert Path("pairs.png").exists()
    Path("mine.csv").write_text("step,1,2,3\n1,5,5,5\n2,4,3,2\n")
    mine = dfdbench("rig optics pairs --lens mine.csv --range 1 3 --out a.png")
    assert "2-1" in mine.out
    assert Path("a.png").exists()


def test_a_lens_is_measured_from_its_captures(dfdbench: Command) -> None:
    assert "46 images" in dfdbench("rig simulate lens --out dots").out
    measured = dfdbench.fine("rig optics sharpness dots")
    assert "54.75" in measured.out
    assert "going down" in measured.out
    assert {path.name for path in Path("sharpness").iterdir()} == {"temperature.png", "voltage.png"}


PIXEL = "--pixel 4.8um"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (f"{BLUR} --pixel 4.8", "--pixel"),
        (f"{BLUR} --pixel 4.8m", "1mm at most"),
        (f"{BLUR} {PIXEL} --range 4 1", "the range is empty"),
        (f"{BLUR} {PIXEL} --out /proc/no/blur.png", "cannot write the answer"),
        (f"{BLUR} {PIXEL} --out blur.jpg", "not a picture's name"),
        (f"{BLUR} {PIXEL} --range 5mm 8mm", "within the focal length"),
        (f"{BLUR} {PIXEL} --f-number -1", "f_number"),
        (f"{BLUR} {PIXEL} --focus 1mm", "focus_distance"),
        ("rig optics pairs --lens none.csv", "cannot read the lens table"),
        ("rig optics pairs --range 5 6", "0.4 to 4 m"),
    ],
)
def test_a_mistake_is_told_and_nothing_printed(dfdbench: Command, words: str, told: str) -> None:
    assert dfdbench.refused(told, words).out == ""
