from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.errors import InputError
from dfdbench.training.checkpoint import Log, TrainingFolder

IDENTITY = {"method": "dfd-net", "configuration": {"crop": 32, "noise": 0.0}}


def rows(first: int, last: int) -> Log:
    losses = [{"step": step, "learning_rate": 0.1, "loss": step / 3} for step in range(first, last)]
    return Log(losses, [{"step": last - 1, "test_nmae": 0.5}])


@pytest.fixture
def folder(tmp_path: Path) -> TrainingFolder:
    made = TrainingFolder(tmp_path / "training")
    made.save(IDENTITY, {"step": 4, "network": torch.ones(2)}, rows(1, 5))
    return made


def test_what_was_saved_comes_back(folder: TrainingFolder) -> None:
    assert folder.started
    state = folder.load(IDENTITY)
    assert state["step"] == 4
    assert torch.equal(state["network"], torch.ones(2))
    log = folder.log()
    assert [float(row["loss"]) for row in log.losses] == [step / 3 for step in range(1, 5)]
    assert log.scores == [{"step": "4", "test_nmae": "0.5"}]


def test_rows_after_the_checkpoint_are_left_out(folder: TrainingFolder) -> None:
    # As a kill leaves it between the log and the checkpoint, the last line cut short.
    with (folder.path / "losses.csv").open("a") as file:
        file.write("5,0.1,9\n6,0.1,9\n1")
    folder.load(IDENTITY)
    assert [row["step"] for row in folder.log().losses] == ["1", "2", "3", "4"]


def test_another_training_is_refused_by_what_differs(folder: TrainingFolder) -> None:
    other = {"method": "u-net", "configuration": {"crop": 32, "noise": 2.0}}
    with pytest.raises(InputError) as caught:
        folder.load(other)
    found = {problem.where.rpartition(": ")[2]: problem.got for problem in caught.value.problems}
    assert found == {"method": "u-net", "configuration.noise": "2.0"}


def test_damaged_checkpoints_and_those_of_another_version(folder: TrainingFolder) -> None:
    path = folder.path / "checkpoint.pt"
    content = path.read_bytes()
    lacking = io.BytesIO()
    torch.save({"version": 1}, lacking)
    half = content[: len(content) // 2]
    for damaged in (b"", b"hello", b"no checkpoint", half, content[:500], lacking.getvalue()):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="the checkpoint cannot be read"):
            folder.load(IDENTITY)
    torch.save({"version": 0, "identity": "{}"}, path)
    with pytest.raises(InputError, match="another version"):
        folder.load(IDENTITY)


@pytest.mark.parametrize(
    "changes",
    [
        {"version": "1"},
        {"version": [[1] * 9] * 9},
        {"step": None},
        {"step": -1},
        {"step": 4.0},
        {"identity": None},
        {"identity": "[" * 100_000},
        {"identity": "1" * 10_000},
        {"identity": "[]"},
    ],
)
def test_what_a_checkpoint_says_is_of_its_kind(
    folder: TrainingFolder, changes: dict[str, object]
) -> None:
    state = {"version": 1, "identity": "{}", "step": 4, **changes}
    torch.save(state, folder.path / "checkpoint.pt")
    with pytest.raises(InputError, match="the checkpoint cannot be read"):
        folder.load({})


def test_a_compressed_checkpoint_is_not_unpacked(folder: TrainingFolder) -> None:
    path = folder.path / "checkpoint.pt"
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(InputError, match="the checkpoint cannot be read") as told:
        folder.load(IDENTITY)
    assert "compressed" in told.value.problems[0].got


@pytest.mark.parametrize("step", [3, 5, 10**12])
def test_the_log_has_a_row_for_each_step_of_the_checkpoint(
    folder: TrainingFolder, step: int
) -> None:
    torch.save({"version": 1, "identity": "{}", "step": step}, folder.path / "checkpoint.pt")
    if step <= 4:
        assert folder.load({})["step"] == step
        return
    with pytest.raises(InputError, match="the log of the training cannot be read") as told:
        folder.load({})
    assert told.value.problems[0].got == f"4 of the checkpoint's {step:,} steps"


def test_a_checkpoint_runs_no_code(folder: TrainingFolder) -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (print, ("harm",))

    torch.save({"version": 1, "identity": "{}", "evil": Evil()}, folder.path / "checkpoint.pt")
    with pytest.raises(InputError, match="the checkpoint cannot be read"):
        folder.load(IDENTITY)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: text.replace("step", "3"),
        lambda text: text.replace("loss", "channel"),
        lambda text: text.replace("0.3333333333333333", ""),
        lambda text: text.replace("0.1", "half"),
        lambda text: text + "\ud800",
    ],
)
def test_a_damaged_log_is_told(folder: TrainingFolder, spoil: Callable[[str], str]) -> None:
    folder.save({"a": 1}, {"step": 3}, rows(1, 3))
    path = folder.path / "losses.csv"
    path.write_bytes(spoil(path.read_text()).encode("utf-8", "surrogatepass"))
    with pytest.raises(InputError, match="the log of the training cannot be read"):
        folder.load({"a": 1})
