import csv
import io
import shutil
from pathlib import Path

import pytest

from tests.cli.command import Command

SIMULATE = "rig simulate realworld --out raw --steps 129,141 --exposures 40"


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
    parts = ("exposure_ms", "geometry", "texture")
    figures = Path("results/realworld-1-test-pruned/mymodule-predict/figures")
    assert {f"by_{what}.png" for what in parts} < {path.name for path in figures.iterdir()}
    dfdbench.fine("report", str(figures.parent), "--out", "page", "--format", "markdown")
    assert {f"1-by-{what}.png" for what in parts} < {path.name for path in Path("page").iterdir()}
    assert "by texture, protocol valid" in Path("page/report.md").read_text()
    run += " --no-predictions"
    rows = [line.split() for line in ran.out.splitlines()]
    near_right = next(row for row in rows if row[:1] == ["oblique-near-right"])
    assert near_right[-1] == "1/14"
    Path("asking.py").write_text(
        "class Asking:\n"
        "    def __init__(self, recipe): ...\n"
        "    def __call__(self, infocus, defocus): ...\n"
    )
    asking = "run --method asking.py:Asking --dataset realworld --split k34"
    dfdbench.refused("captured images have none", asking)
    assert "| texture | scenes |" in dfdbench(run, "--format", "markdown").out
    lines = csv.DictReader(io.StringIO(dfdbench(run, "--format", "csv").out))
    parted = {line["geometry"]: line for line in lines if line["metric"] == "nrmse"}
    assert parted["oblique-near-right"]["evaluated"] == "1"
    assert parted["flat-near"]["evaluated"] == "0"
    assert '"geometry": "oblique-near-right"' in dfdbench(run, "--format", "json").out


def test_a_lens_is_measured_from_its_captures(dfdbench: Command) -> None:
    assert "46 images" in dfdbench("rig simulate lens --out dots").out
    measured = dfdbench.fine("rig optics sharpness dots")
    assert "54.75" in measured.out
    assert "going down" in measured.out
    assert {path.name for path in Path("sharpness").iterdir()} == {"temperature.png", "voltage.png"}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("rig simulate realworld --out o --scenes k64", "of k00 to k63"),
        ("rig simulate realworld --out o --steps 1-3", "of 127 to 143"),
        ("rig simulate realworld --out o --turn 1,2", "yaw,pitch,roll"),
        ("rig simulate realworld --out o --turn nan,0,0", "10 degrees at most"),
        ("rig register k33 --source .", "no raw captures"),
        ("rig register all --source .", "no raw scene, such as"),
        ("rig register all --source none", "no folder of captures"),
        ("rig register all --source . --dataset middlebury", "not captured by"),
        ("build realworld --source none --pair 141", "voltage steps, as 141,129"),
    ],
)
def test_a_mistake_is_told(dfdbench: Command, words: str, told: str) -> None:
    dfdbench.refused(told, words)
