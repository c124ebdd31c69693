from collections.abc import Sequence
from pathlib import Path

import pytest

from dfdbench.cli.rig import chosen
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import DfdbenchError
from tests.cli.command import Command


@pytest.mark.slow
def test_what_scenes_share_is_told_once(dfdbench: Command) -> None:
    few = ["rig", "simulate", "realworld", "--steps", "135", "--exposures", "40"]
    assert dfdbench(*few, "--out", "raw", "--scenes", "k01,k03").status == 0
    alone = dfdbench("rig register k03 --source raw")
    assert (alone.status, "leave open where the board lies" in alone.out) == (0, True)
    by_hand = Path("raw/k03/registration.toml").read_text() + "# by hand\n"
    Path("raw/k03/registration.toml").write_text(by_hand)
    assert dfdbench("rig register k03 --source raw --fresh").status == 0
    assert Path("raw/k03/registration.previous.toml").read_text() == by_hand
    off = dfdbench("rig register k03 --source raw --fresh --focal-length 80mm")
    assert (off.status, "kept" in off.out) == (2, False)
    Path("raw/k03/registration.toml").write_text("matrix = [[1,0,99999],[0,1,99999],[0,0,1]]\n")
    dfdbench.refused("no LIDAR return falls on the image", "rig register k03 --source raw")
    Path("raw/k03/registration.toml").unlink()
    Path("raw/k03/registration.toml").mkdir()
    dfdbench.refused("cannot write the registration", "rig register k03 --source raw --fresh")
    Path("raw/k03/registration.toml").rmdir()
    head = "beam,altitude_deg,azimuth_deg,azimuth_index\n"
    Path("raw/beams.csv").write_text(head + "".join(f"{n},x,3.1,18\n" for n in range(64)))
    for verb in (["rig", "register", "all"], ["build", "realworld", "--allow-missing"]):
        done = dfdbench(*verb, "--source", "raw")
        assert done.status == 2
        assert done.err.count("altitude_deg is not degrees") == 1, done.err
        assert "line 2, and 63 more lines" in done.err


REALWORLD = find_manifest("realworld")
SCENES, STEPS = REALWORLD.scene_names, range(127, 144)


@pytest.mark.parametrize(
    ("text", "known", "found"),
    [
        ("k33,k00-k02", SCENES, ("k00", "k01", "k02", "k33")),
        ("141, 127-129", STEPS, (127, 128, 129, 141)),
        # A span may pass over what is not known; its ends may not.
        ("10-40", (10, 20, 40), (10, 20, 40)),
    ],
)
def test_a_list_is_put_in_order(
    text: str, known: Sequence[object], found: tuple[object, ...]
) -> None:
    assert chosen(text, "--steps", known) == found


@pytest.mark.parametrize(
    ("text", "known", "said"),
    [
        ("k64", SCENES, "not of k00 to k63"),
        ("k3", SCENES, "did you mean"),
        ("k03-k01", SCENES, "Fix: k01-k03"),
        *((text, STEPS, "unknown value") for text in ("", "x", "-130", "126-130", "127-128-129")),
    ],
)
def test_what_a_list_cannot_name_is_said(text: str, known: Sequence[object], said: str) -> None:
    with pytest.raises(DfdbenchError) as caught:
        chosen(text, "--steps", known)
    assert said in str(caught.value)
    assert caught.value.problems[0].where == "--steps"
