from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.datasets.store import Store
from tests.cli.command import Command
from tests.conftest import write_png

QUICK = [
    "--set",
    "narrow=64",
    "--set",
    "crop=16",
    "--set",
    "crops_per_step=1",
    "--set",
    "steps=4",
    "--set",
    "evaluate_every=2",
    "--set",
    "evaluate_pairs=1",
    "--device",
    "cpu",
    "--threads",
    "1",
]


def test_train_then_run(dfdbench: Command, tiny_store: Store) -> None:
    store = ["--dataset", str(tiny_store.path)]
    done = dfdbench("train", "dfd-net", *store, *QUICK)
    assert done.status == 0, done.err
    folder = Path("training/tiny-train/dfd-net-published")
    assert {path.name for path in folder.iterdir()} == {
        "checkpoint.pt",
        "depth_levels.csv",
        "depth_levels.png",
        "losses.csv",
        "scores.csv",
        "patches.csv",
        "patches.png",
        "training.png",
        "weights.md",
        "weights.safetensors",
    }
    assert "ended by its number of steps" in done.out
    assert "NMAE on test, 7 pairs" in done.out
    assert "4 patches drawn, by pair" in done.out
    rows = (folder / "patches.csv").read_text().splitlines()
    assert rows[0] == "pair,patches,pixel_least,pixel_mean,pixel_most"
    assert sum(int(row.split(",")[1]) for row in rows[1:]) == 4
    weights = f"weights={folder / 'weights.safetensors'}"
    run = dfdbench("run", "--method", "dfd-net", "--param", weights, *store)
    assert run.status == 0, run.err


def test_a_folder_in_use_wants_a_word(dfdbench: Command, tiny_store: Store) -> None:
    train = ["train", "dfd-net", "--dataset", str(tiny_store.path), *QUICK]
    early = dfdbench(*train, "--resume")
    assert early.status == 2
    assert "no checkpoint to go on from" in early.err
    assert dfdbench(*train, "--max-time", "0.001s").status == 0
    again = dfdbench(*train)
    assert again.status == 2
    assert "--resume goes on, --fresh starts anew" in again.err
    resumed = dfdbench(*train, "--resume")
    assert resumed.status == 0, resumed.err
    assert "4, ended by its number of steps" in resumed.out
    assert dfdbench(*train, "--resume", "--fresh").status == 2
    weights = Path("training/tiny-train/dfd-net-published/weights.safetensors")
    for mistake in (["--set", "crop=17"], ["--device", "tpu"], ["--weights", str(weights)]):
        assert dfdbench(*train, "--fresh", *mistake).status == 2
        assert weights.exists(), mistake
    over = dfdbench(*train, "--resume", "--max-time", "0.0001s")
    assert (over.status, " 4, ended by its number of steps" in over.out) == (0, True), over.out
    (weights.parent / "checkpoint.pt").unlink()
    assert "--fresh starts anew" in dfdbench(*train).err
    beside = Path("training/tiny-train/dfd-net-published/notes.txt")
    beside.write_text("keep")
    assert dfdbench(*train, "--fresh").status == 0
    assert beside.read_text() == "keep"
    Path("other").mkdir()
    Path("other/precious.txt").write_text("keep")
    taken = dfdbench(*train, "--out", "other", "--fresh")
    assert taken.status == 2
    assert Path("other/precious.txt").read_text() == "keep"


def test_users_mistakes_end_with_status_2(dfdbench: Command, tiny_store: Store) -> None:
    Path("taken").write_text("keep")
    store = ["--dataset", str(tiny_store.path)]
    for arguments, message in (
        (["--max-time", "30"], "as 90s, 30m, 1h30m"),
        (["--max-time", "soon"], "as 90s, 30m, 1h30m"),
        (["--max-time", "0s"], "as 90s, 30m, 1h30m"),
        (["--set", "filters=[]"], "at least 1 item"),
        (["--set", "noise=nan"], "noise"),
        (["--set", "normalization=fixed"], "needs weights to begin with"),
        (["--fold", "K1", "--split", "train"], "give one of them"),
        (["--seed", "9" * 20], "--seed"),
        (["--weights", "none.safetensors"], "no such weights"),
        (["--out", "taken"], "not a folder"),
        (["--set", "noise"], "NAME=VALUE"),
        (["--set", "nois=1"], "unknown choice"),
        (["--config", "no.toml"], "published"),
        (["--fold", "K9"], "K1"),
        (["--split", "trian"], "train"),
        (["--device", "tpu"], "cpu"),
        (["--set", "crop=64"], "at most 24"),
    ):
        done = dfdbench("train", "dfd-net", *store, *arguments)
        assert done.status == 2, arguments
        assert message in done.err, arguments
        assert "Traceback" not in done.err
    assert not Path("training").exists()
    for values, message in (("", "not a list"), ("16,17", "multiple of 4"), ("16,64", "24")):
        early = dfdbench("experiment", "patch-size", *store, *QUICK[:2], "--values", values)
        assert (early.status, message in early.err) == (2, True), early.err
    assert not Path("training").exists()
    wrong = dfdbench("experiment", "nose", *store)
    assert wrong.status == 2
    assert "did you mean noise" in wrong.err


def test_an_experiment_goes_on_and_writes_its_table(dfdbench: Command, tiny_store: Store) -> None:
    command = ["experiment", "cross-validation", "--dataset", str(tiny_store.path), *QUICK]
    done = dfdbench(*command)
    assert done.status == 0, done.err
    folder = Path("training/tiny-experiments/cross-validation-dfd-net")
    table = (folder / "scores.md").read_text()
    assert "K1" in table
    assert "K2" in table
    before = (folder / "K1-seed0/weights.safetensors").stat().st_mtime_ns
    again = dfdbench(*command, "--format", "csv")
    assert again.out == (folder / "scores.csv").read_text()
    assert (folder / "K1-seed0/weights.safetensors").stat().st_mtime_ns == before
    assert (folder / "scores.png").stat().st_size > 5000


def test_voltage_pairs_are_built_and_trained_into_one_table(dfdbench: Command) -> None:
    random = np.random.default_rng(4)
    for scene in ("k33", "k37"):
        for step in (129, 135, 141):
            image = random.integers(0, 256, (630, 630, 3)).astype(np.uint8)
            write_png(Path(f"site/{scene}/left/exp_30/image_{step}_30.00.png"), image)
        levels = np.linspace(150, 220, 630).astype(np.uint8)[np.newaxis].repeat(630, axis=0)
        write_png(Path(f"site/{scene}/lidar/lidar_rng_left_00000_8bit_x6.png"), levels)
    command = ["experiment", "voltage-pairs", "--values", "135-129,141-129", *QUICK]
    unnamed = dfdbench(*command)
    assert (unnamed.status, "--source DIR" in unnamed.err) == (2, True), unnamed.err
    for values, told in (("135", "as 141-129,140-130"), ("135-129,135-150", "two of 127 to 143")):
        wrong = dfdbench("experiment", "voltage-pairs", "--values", values, "--source", "site")
        assert (wrong.status, told in wrong.err) == (2, True), wrong.err
    assert "--source DIR" in dfdbench(*command).err  # nothing was built before it was told
    done = dfdbench(*command, "--source", "site", "--format", "csv")
    assert done.status == 0, done.err
    folder = Path("training/realworld-2-experiments/voltage-pairs-dfd-net")
    assert {"135-129-seed0", "141-129-seed0"} < {path.name for path in folder.iterdir()}
    assert "135-129" in done.out
    assert "141-129" in done.out
    card = (folder / "135-129-seed0/weights.md").read_text()
    assert "realworld-2, split train-pruned" in card
    again = dfdbench(*command, "--format", "csv")  # the sets lie in the cache
    assert (again.status, again.out) == (0, done.out), again.err
