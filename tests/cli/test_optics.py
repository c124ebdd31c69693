from pathlib import Path

import pytest

from tests.cli.command import Command

BLUR = ("rig", "optics", "blur", "--f-number", "3.7", "--focal-length", "9.6mm", "--focus", "0.5m")


def test_blur_prints_a_table_and_draws_the_curve(dfdbench: Command) -> None:
    outcome = dfdbench.fine(*BLUR, "--pixel", "4.8um", "--range", "40cm", "4")
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


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((*BLUR, "--pixel", "4.8"), "--pixel"),
        ((*BLUR, "--pixel", "4.8um", "--range", "4", "1"), "the range is empty"),
        (("rig", "optics", "pairs", "--lens", "none.csv"), "cannot read the lens table"),
        (("rig", "optics", "pairs", "--range", "5", "6"), "0.4 to 4 m"),
        ((*BLUR, "--pixel", "4.8um", "--out", "/proc/no/blur.png"), "cannot write the answer"),
    ],
)
def test_a_mistake_ends_with_a_message_and_status_2(
    dfdbench: Command, arguments: tuple[str, ...], told: str
) -> None:
    dfdbench.refused(told, *arguments)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--pixel", "4.8m"], "1mm at most"),
        (["--f-number", "-1"], "f_number"),
        (["--focus", "1mm"], "focus_distance"),
        (["--range", "5mm", "8mm"], "within the focal length"),
        (["--out", "blur.jpg"], "not a picture's name"),
    ],
)
def test_a_lens_that_cannot_be_is_told_by_its_options(
    dfdbench: Command, given: list[str], told: str
) -> None:
    lens = {"--f-number": "3.7", "--focal-length": "9.6mm", "--focus": "0.5m", "--pixel": "4.8um"}
    kept = [text for option in lens.items() if option[0] not in given for text in option]
    done = dfdbench("rig optics blur", *kept, *given)
    assert (done.status, told in done.err, done.out) == (2, True, ""), done.err
