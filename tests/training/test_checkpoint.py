from __future__ import annotations

import hashlib
import io
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.errors import InputError
from dfdbench.training.checkpoint import Log, TrainingFolder

IDENTITY = {"method": "dfd-net", "configuration": {"crop": 32, "noise": 0.0, "betas": (0.5, 0.99)}}
LOG = Log(
    [{"step": step, "learning_rate": 0.1, "loss": step / 3} for step in range(1, 5)],
    [{"step": 2}, {"step": 4, "test_nmae": 0.5}],
)


@pytest.fixture
def folder(tmp_path: Path) -> TrainingFolder:
    made = TrainingFolder(tmp_path / "training")
    made.save(IDENTITY, {"step": 4, "network": torch.ones(2)}, LOG)
    return made


def test_what_was_saved_comes_back(folder: TrainingFolder) -> None:
    assert folder.started
    state, log = folder.load(IDENTITY)
    assert state["step"] == 4
    assert torch.equal(state["network"], torch.ones(2))
    assert log == LOG
    assert (folder.path / "scores.csv").read_text() == "step,test_nmae\n2,\n4,0.5\n"
    assert len((folder.path / "losses.csv").read_text().splitlines()) == 5


def test_another_training_is_refused_by_what_differs(folder: TrainingFolder) -> None:
    other = {"method": "u-net", "configuration": IDENTITY["configuration"] | {"noise": 2.0}}  # type: ignore[operator]
    with pytest.raises(InputError) as caught:
        folder.load(other)
    assert [problem.what.partition("with ")[2] for problem in caught.value.problems] == [
        "method dfd-net instead of u-net",
        "configuration.noise 0.0 instead of 2.0",
    ]


def test_a_checkpoint_that_was_changed_is_refused(folder: TrainingFolder) -> None:
    path = folder.path / "checkpoint.pt"
    content = path.read_bytes()
    half, flipped = content[: len(content) // 2], bytearray(content)
    flipped[200] ^= 1
    for damaged in (b"", b"hello", half, content[:500], bytes(flipped), content + b"x"):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="damaged checkpoint"):
            folder.load(IDENTITY)
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match="cannot read the checkpoint: Is a directory"):
        folder.load(IDENTITY)


def test_a_checkpoint_runs_no_code(folder: TrainingFolder) -> None:
    class Evil:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (pytest.fail, ("it ran",))

    content = io.BytesIO()
    torch.save({"evil": Evil()}, content)
    body = content.getvalue()
    (folder.path / "checkpoint.pt").write_bytes(body + hashlib.sha256(body).digest())
    with pytest.raises(Exception, match="weights_only"):
        folder.load(IDENTITY)
