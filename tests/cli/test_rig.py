import shutil
from pathlib import Path

import pytest

from tests.cli.command import Command

BLUR = "rig optics blur --f-number 3.7 --focal-length 9.6mm --focus 0.5m"
PIXEL = "--pixel 4.8um"
SIMULATE = "rig simulate realworld --out raw --steps 129,141 --exposures 40"


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
    assert "2-1" in dfdbench("rig optics pairs --lens mine.csv --range 1 3 --out a.png").out
    assert Path("a.png").exists()


def test_a_lens_is_measured_from_its_captures(dfdbench: Command) -> None:
    made = dfdbench.fine("rig simulate lens --out", "white dots")
    assert "46 images" in made.out
    assert made.err.endswith("dfdbench rig optics sharpness 'white dots'\n")
    measured = dfdbench.fine("rig optics sharpness", "white dots")
    assert "54.75" in measured.out
    assert "going down" in measured.out
    assert {path.name for path in Path("sharpness").iterdir()} == {"temperature.png", "voltage.png"}


@pytest.mark.slow
def test_the_whole_way_from_captures_to_scores(dfdbench: Command) -> None:
    made = dfdbench.fine(SIMULATE, "--scenes", "k34")
    assert "dfdbench rig register k34 --source raw" in made.err
    assert "simulated 0 scenes, 1 kept from before" in dfdbench(SIMULATE, "--scenes", "k34").out

    unregistered = dfdbench.refused("nothing to build", "build realworld --source raw")
    assert "dfdbench rig register k34 --source raw" in unregistered.err

    dfdbench.fine("rig register k34 --source raw")
    assert Path("raw/k34/registration.png").read_bytes().startswith(b"\x89PNG")
    by_hand = Path("raw/k34/registration.toml").read_text() + "# looked at\n"
    Path("raw/k34/registration.toml").write_text(by_hand)
    shutil.copytree("raw/k34/frames", "raw/k35/frames")
    some = dfdbench("rig register all --source raw")
    assert (some.status, "scene has no lidar/" in some.err, "kept" in some.out) == (2, True, True)
    assert Path("raw/k34/registration.toml").read_text() == by_hand
    shutil.rmtree("raw/k35")
    assert "estimated" in dfdbench("rig register k34 --source raw --fresh").out

    built = dfdbench("build realworld --source raw --allow-missing")
    assert (built.status, "1 pair of 1 scene" in built.out) == (0, True), built.err
    dfdbench.refused("--store PATH", "build realworld --source raw --pair 129,141")

    run = "run --method mymodule:predict --dataset realworld --split test-pruned --tables"
    ran = dfdbench.fine(run)
    run_folder = Path("results/realworld-1-test-pruned/mymodule-predict")
    dfdbench.fine(f"report {run_folder} --out page --format markdown")
    for what in ("exposure_ms", "geometry", "texture"):
        assert (run_folder / f"figures/by_{what}.png").exists()
        assert Path(f"page/1-by-{what}.png").exists()
    assert "by texture, protocol valid" in Path("page/report.md").read_text()
    rows = [line.split() for line in ran.out.splitlines()]
    assert next(row for row in rows if row[:1] == ["oblique-near-right"])[-1] == "1/14"
    asking = "run --method mymodule:Asking --dataset realworld --split k34"
    dfdbench.refused("captured images have none", asking)


def test_a_mistake_is_told_and_nothing_printed(dfdbench: Command) -> None:
    for words, told in (
        ("rig simulate realworld --out o --scenes k64", "of k00 to k63"),
        ("rig simulate realworld --out o --scenes k03-k01", "Fix: k01-k03"),
        ("rig simulate realworld --out o --scenes x", "unknown value"),
        ("rig simulate realworld --out o --steps 1-3", "of 127 to 143"),
        ("rig simulate realworld --out o --turn 1,2", "yaw,pitch,roll"),
        ("rig register k33 --source .", "no raw captures"),
        ("rig register all --source .", "no raw scene, such as"),
        ("rig register all --source none", "no folder of captures"),
        ("rig register all --source . --dataset middlebury", "not captured by"),
        ("build realworld --source none --pair 141", "voltage steps (--pair): expected as 141,129"),
        (f"{BLUR} --pixel 4.8m", "1mm at most"),
        (f"{BLUR} {PIXEL} --range 4 1", "the range is empty"),
        (f"{BLUR} {PIXEL} --out /proc/no/blur.png", "directory (/proc/no)\nFix: choose"),
        (f"{BLUR} {PIXEL} --range 5mm 8mm", "within the focal length"),
        (f"{BLUR} {PIXEL} --focus 1mm", "focus_distance"),
        ("rig optics pairs --lens none.csv", "cannot read the lens table"),
        ("rig optics pairs --range 1.52 1.58", "widen it: distances are measured 0.1 m apart, 0.4"),
        ("rig optics pairs --range 5 6", "0.4 to 4 m"),
    ):
        assert dfdbench.refused(told, words).out == ""


@pytest.mark.slow
def test_what_scenes_share_is_told_once(dfdbench: Command) -> None:
    few = ["rig", "simulate", "realworld", "--steps", "135", "--exposures", "40"]
    assert dfdbench(*few, "--out", "raw", "--scenes", "k01,k03").status == 0
    assert "leave open where the board lies" in dfdbench.fine("rig register k03 --source raw").out
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
