from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.datasets.dataset import Dataset
from tests.cli.command import QUICK, Command
from tests.conftest import write_png


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
