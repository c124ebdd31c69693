from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.cli import training
from dfdbench.datasets.dataset import Dataset
from tests.cli.command import QUICK, Command

shipped = pytest.importorskip("dfdbench.methods.networks.weights", reason="needs the extra nets")


@pytest.mark.slow
def test_train_then_run(dfdbench: Command, tiny_store: Dataset) -> None:
    store = ["--dataset", str(tiny_store.path)]
    done = dfdbench.fine("train dfd-net", *store, *QUICK)
    folder = Path("training/tiny-train/dfd-net-published")
    assert " ".join(sorted(path.name for path in folder.iterdir())) == (
        "checkpoint.pt depth_levels.csv depth_levels.png losses.csv patches.csv patches.png "
        "scores.csv training.png weights.md weights.safetensors"
    )
    assert "ended by its number of steps" in done.out
    assert "NMAE on test, 7 pairs" in done.out
    assert "4 patches drawn, by pair" in done.out
    weights = f"weights={folder / 'weights.safetensors'}"
    dfdbench.fine("run --method dfd-net --param", weights, *store)


@pytest.mark.slow
def test_a_folder_in_use_wants_a_word(dfdbench: Command, tiny_store: Dataset) -> None:
    train = ["train", "dfd-net", "--dataset", str(tiny_store.path), *QUICK]
    dfdbench.refused("no checkpoint to go on from", *train, "--resume")
    assert dfdbench(*train, "--max-time", "0.001s").status == 0
    dfdbench.refused("--resume goes on, --fresh starts anew", *train)
    assert "4, ended by its number of steps" in dfdbench.fine(*train, "--resume").out
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
    dfdbench.refused("something other than a training", *train, "--out", "other", "--fresh")
    assert Path("other/precious.txt").read_text() == "keep"


def test_users_mistakes_end_with_status_2(dfdbench: Command, tiny_store: Dataset) -> None:
    Path("taken").write_text("keep")
    store = ["--dataset", str(tiny_store.path)]
    for arguments, message in (
        (["--max-time", "30"], "as 90s, 30m or 1h30m"),
        (["--fold", "K1", "--split", "train"], "--fold cannot be given with --split"),
        (["--weights", "none.safetensors"], "no such weights"),
        (["--out", "taken"], "not a folder"),
        (["--set", "nois=1"], "unknown choice"),
        (["--config", "no.toml"], "published"),
        (["--device", "tpu"], "cpu"),
    ):
        dfdbench.refused(message, "train dfd-net", *store, *arguments)
    assert not Path("training").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("demo_built")
@pytest.mark.parametrize(("network", "track"), [("volume-net", ""), ("stack-net", "@stack-3")])
def test_train_on_a_data_set_then_run(dfdbench: Command, network: str, track: str) -> None:
    if track:
        dfdbench.fine(f"build demo{track}")
    done = dfdbench.fine(f"train {network} --dataset demo{track} --set steps=2 --threads 1")
    assert f"demo-1{track}, split train" in done.out
    folder = Path(f"training/demo-1{track}-train/{network}")
    assert "ended by its number of steps" in done.out
    weights = f"weights={folder / 'weights.safetensors'}"
    dfdbench.fine(f"run --method {network} --dataset demo{track} --limit 1 --param", weights)


@pytest.mark.slow
def test_the_next_command_is_one_that_tests_what_was_trained(
    dfdbench: Command, tiny_store: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dfdbench.training import stacks

    store = ["--dataset", str(tiny_store.path)]
    told = dfdbench.fine("train dfd-net --fold K1", *store, *QUICK).err
    assert f"next         dfdbench run --method dfd-net --dataset {store[1]} --split K1 " in told
    images = np.random.default_rng(0).integers(1, 255, (3, 32, 32, 3), np.uint8)
    room = stacks.Stack(images, np.array([1, 2, 3], np.float32), np.full((32, 32), 2, np.float32))
    course = stacks.STACK_NET
    course = replace(course, of_rooms=lambda *_: {"room": [room]}, of_captures=lambda _: [room])
    monkeypatch.setattr(stacks, "STACK_NET", course)
    told = dfdbench.fine("train stack-net --set steps=1 --threads 1").err
    assert "next         dfdbench run --method stack-net --dataset unseen-stack-7 --param" in told
    told = dfdbench.fine("train stack-net --split test --set steps=1 --threads 1", *store).err
    assert f"dfdbench run --method stack-net --dataset {store[1]} --split train --param" in told


def test_volume_net_names_all_choices_that_it_has_not(dfdbench: Command) -> None:
    weights = shipped.find_weights("dfd-net", "demo")
    for arguments, message in (
        ("--fold K1 --device cpu", "--fold and --device cannot be given with volume-net"),
        ("--split train", "add --dataset, or leave out --split"),
        ("--set crop=64 --set steps=0", "no number of steps (--set steps)"),
        ("--set crop=64 --set steps=0", "volume-net has no such choice (--set crop)"),
        (f"--weights {weights}", "dfd-net instead of volume-net"),
    ):
        dfdbench.refused(message, f"train volume-net {arguments}")
    assert not Path("training").exists()


def test_each_network_and_version_keeps_its_own_rendered_rooms(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dfdbench.training import stacks, volumes

    asked: list[Path] = []

    def of_rooms(folder: Path, _: object) -> dict[str, list[Any]]:
        asked.append(folder)
        raise InterruptedError

    for method, module in (("stack-net", stacks), ("volume-net", volumes)):
        name = method.replace("-", "_").upper()
        monkeypatch.setattr(module, name, replace(getattr(module, name), of_rooms=of_rooms))
        for version in ("1.0", "1.1"):
            monkeypatch.setattr(training, "PACKAGE_VERSION", version)
            make = training._on_cameras(method, None, None, None, 0, {})[1]
            with pytest.raises(InterruptedError):
                make(tmp_path / method)
    assert len(set(asked)) == 4
    assert {folder.parent for folder in asked} == {tmp_path / "examples"}
