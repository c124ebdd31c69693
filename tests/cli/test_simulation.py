from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.command import Command

SIMULATE = ["rig", "simulate", "realworld", "--steps", "129,141", "--exposures", "40"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--out", "raw", "--scenes", "k03-k01"], "no scene in that span"),
        (["--out", "taken.txt", "--scenes", "k03"], "cannot write the answer"),
        (["--out", "raw", "--scenes", "k03", "--turn", "1,nan,2"], "10 degrees at most"),
    ],
)
def test_simulate_says_what_it_cannot_do(
    dfdbench: Command, arguments: list[str], told: str
) -> None:
    Path("taken.txt").write_text("keep")
    done = dfdbench(*SIMULATE, *arguments)
    assert (done.status, told in done.err, "Traceback" in done.err) == (2, True, False)
    assert Path("taken.txt").read_text() == "keep"
