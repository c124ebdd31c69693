from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.methods.networks.weights import build_network, save_weights
from tests.cli.command import QUICK, Command
from tests.conftest import write_png
from tests.methods.made_weights import card, save_small

pytest.importorskip("torch", reason="needs the extra nets")


@pytest.mark.slow
def test_an_experiment_goes_on_and_writes_its_table(dfdbench: Command, tiny_store: Dataset) -> None:
    command = [
        "thesis",
        "experiment",
        "cross-validation",
        "--dataset",
        str(tiny_store.path),
        *QUICK,
    ]
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


def test_users_mistakes_end_with_status_2(dfdbench: Command, tiny_store: Dataset) -> None:
    store = ["--dataset", str(tiny_store.path)]
    for values, message in (("", "not a list"), ("16,17", "multiple of 4"), ("16,64", "24")):
        early = dfdbench(
            "thesis", "experiment", "patch-size", *store, *QUICK[:2], "--values", values
        )
        assert (early.status, message in early.err) == (2, True), early.err
    assert not Path("training").exists()
    wrong = dfdbench("thesis", "experiment", "nose", *store)
    assert wrong.status == 2
    assert "did you mean noise" in wrong.err


@pytest.mark.slow
def test_voltage_pairs_are_built_and_trained_into_one_table(dfdbench: Command) -> None:
    random = np.random.default_rng(4)
    for scene in ("k33", "k37"):
        for step in (129, 135, 141):
            image = random.integers(0, 256, (630, 630, 3)).astype(np.uint8)
            write_png(Path(f"site/{scene}/left/exp_30/image_{step}_30.00.png"), image)
        levels = np.linspace(150, 220, 630).astype(np.uint8)[np.newaxis].repeat(630, axis=0)
        write_png(Path(f"site/{scene}/lidar/lidar_rng_left_00000_8bit_x6.png"), levels)
    command = ["thesis", "experiment", "voltage-pairs", "--values", "135-129,141-129", *QUICK]
    unnamed = dfdbench(*command)
    assert (unnamed.status, "--source DIR" in unnamed.err) == (2, True), unnamed.err
    for values, told in (("135", "as 141-129,140-130"), ("135-129,135-150", "two of 127 to 143")):
        wrong = dfdbench(
            "thesis", "experiment", "voltage-pairs", "--values", values, "--source", "site"
        )
        assert (wrong.status, told in wrong.err) == (2, True), wrong.err
    assert "--source DIR" in dfdbench(*command).err  # nothing was built before it was told
    done = dfdbench(*command, "--source", "site", "--format", "csv")
    assert done.status == 0, done.err
    folder = Path("training/realworld-1-experiments/voltage-pairs-dfd-net")
    assert {"135-129-seed0", "141-129-seed0"} < {path.name for path in folder.iterdir()}
    assert "135-129" in done.out
    assert "141-129" in done.out
    card = (folder / "135-129-seed0/weights.md").read_text()
    assert "realworld-1, split train-pruned" in card
    again = dfdbench(*command, "--format", "csv")  # the sets lie in the cache
    assert (again.status, again.out) == (0, done.out), again.err


FEW = [
    item
    for choice in ("crop=16", "crops_per_step=1", "steps=2", "evaluate_pairs=1")
    for item in ("--set", choice)
]
HERE = ["--device", "cpu", "--threads", "1"]


@pytest.mark.slow
def test_reduced_networks_are_written_trained_and_compared(
    dfdbench: Command, tiny_store: Dataset
) -> None:
    weights, dataset = str(save_small(Path("mine.safetensors"))), str(tiny_store.path)
    done = dfdbench(
        "thesis", "reduce", "--weights", weights, "--dataset", dataset, "--rounds", "H", *FEW, *HERE
    )
    assert done.status == 0, done.err
    assert "noise, mean" in done.out
    folder = Path("training/tiny-reduction/mine")
    assert str(folder) in done.err
    assert (folder / "B-03-03H.toml").exists()
    assert "no zero point" in (folder / "counts.md").read_text()
    command = [
        "thesis",
        "experiment",
        "reduction",
        "--dataset",
        dataset,
        "--rows",
        str(folder),
        *HERE,
    ]
    command += ["--values", "original,B-01-01", "--repeats", "2"]
    trained = dfdbench(*command, "--format", "csv")
    assert trained.status == 0, trained.err
    kept = Path("training/tiny-experiments/reduction-dfd-net")
    lines = trained.out.splitlines()
    assert [line.split(",")[0] for line in lines[1:]] == ["original", "B-01-01"] * 2
    assert lines[-1].endswith("thesis-networks-2")
    assert {path.name for path in kept.iterdir() if path.is_dir()} == {
        f"{name}-seed{seed}" for name in ("original", "B-01-01") for seed in (0, 1)
    }
    assert (kept / "scores.png").exists()
    one = dfdbench(
        "train", "dfd-net", "--config", str(folder / "B-01-01.toml"), "--dataset", dataset, *HERE
    )
    assert one.status == 0, one.err


def test_users_mistakes_end_with_status_2_reduction(dfdbench: Command, tiny_store: Dataset) -> None:
    small = str(save_small(Path("mine.safetensors")))
    unet = {"filters": [2, 4, 8, 16, 32]}
    made = card(method="u-net", architecture=unet)
    save_weights(Path("unet.safetensors"), build_network("u-net", unet), made)
    wide = {"filters": [*[4] * 6, 50, 4, 50, *[4] * 8, 256]}
    save_weights(Path("wide.safetensors"), build_network("dfd-net", wide), card(architecture=wide))
    Path("none.safetensors").write_text("nothing")
    dataset = ["--dataset", str(tiny_store.path), *HERE]
    for arguments, told in (
        (["--weights", "unet.safetensors"], "another architecture"),
        (["--weights", "wide.safetensors"], "fewer pixels than filters"),
        (["--weights", "none.safetensors"], "cannot be read"),
        (["--weights", "nowhere.safetensors"], "no such weights"),
        (["--weights", small, "--level", "4"], "there is no level 4"),
        (["--weights", small, "--split", "tset"], "test"),
        (["--weights", small, "--config", "publisht"], "no such configuration"),
    ):
        wrong = dfdbench("thesis", "reduce", *arguments, *dataset)
        assert (wrong.status, told in wrong.err) == (2, True), wrong.err
        assert "Traceback" not in wrong.err
    assert not Path("training").exists()


def test_unknown_rows_are_named_before_anything_is_trained(
    dfdbench: Command, tiny_store: Dataset
) -> None:
    dataset = ["--dataset", str(tiny_store.path), *HERE]
    Path("rows").mkdir()
    Path("rows/original.toml").write_text("crop = 16\nsteps = 1\n")
    for arguments, told in (
        (["reduction", "--rows", "rows", "--values", "B-09-01"], "unknown row"),
        (["reduction", "--rows", "nowhere"], "lacks original.toml"),
        (["reduction", "--values", "B-09-01", *FEW], "B-01-01"),
        (["reduction", "--rows", "rows", "--config", "demo"], "its own configuration"),
        (["noise", "--rows", "rows"], "has no rows"),
    ):
        wrong = dfdbench("thesis", "experiment", *arguments, *dataset)
        assert (wrong.status, told in wrong.err) == (2, True), wrong.err
    assert not Path("training").exists()
