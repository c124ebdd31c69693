from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.command import Command


@pytest.mark.slow
def test_what_scenes_share_is_told_once(dfdbench: Command) -> None:
    few = ["rig", "simulate", "realworld", "--steps", "135", "--exposures", "40"]
    assert dfdbench(*few, "--out", "raw", "--scenes", "k01,k03").status == 0
    alone = dfdbench("rig", "register", "k03", "--source", "raw")
    assert (alone.status, "leave open where the board lies" in alone.out) == (0, True)
    by_hand = Path("raw/k03/registration.toml").read_text() + "# by hand\n"
    Path("raw/k03/registration.toml").write_text(by_hand)
    assert dfdbench("rig", "register", "k03", "--source", "raw", "--fresh").status == 0
    assert Path("raw/k03/registration.previous.toml").read_text() == by_hand
    off = dfdbench("rig", "register", "k03", "--source", "raw", "--fresh", "--focal-length", "80mm")
    assert (off.status, "kept" in off.out) == (2, False)
    Path("raw/k03/registration.toml").write_text("matrix = [[1,0,99999],[0,1,99999],[0,0,1]]\n")
    done = dfdbench("rig", "register", "k03", "--source", "raw")
    assert (done.status, "no LIDAR return falls on the image" in done.err) == (2, True)
    Path("raw/k03/registration.toml").unlink()
    Path("raw/k03/registration.toml").mkdir()
    done = dfdbench("rig", "register", "k03", "--source", "raw", "--fresh")
    assert (done.status, "cannot write the registration" in done.err) == (2, True), done.err
    Path("raw/k03/registration.toml").rmdir()
    head = "beam,altitude_deg,azimuth_deg,azimuth_index\n"
    Path("raw/beams.csv").write_text(head + "".join(f"{n},x,3.1,18\n" for n in range(64)))
    for verb in (["rig", "register", "all"], ["build", "realworld", "--allow-missing"]):
        done = dfdbench(*verb, "--source", "raw")
        assert done.status == 2
        assert done.err.count("altitude_deg is not degrees") == 1, done.err
        assert "line 2, and 63 more lines" in done.err
