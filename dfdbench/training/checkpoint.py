"""A training's folder: its tables and figures, and a checkpoint to continue from."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from dfdbench.errors import InputError, Problem, reason_of
from dfdbench.system.files import read_whole, write_whole
from dfdbench.system.json_text import differences

WEIGHTS = "weights.safetensors"
_CHECKPOINT = "checkpoint.pt"
#: Of a `Log`, in the order of its fields.
_TABLES = ("losses.csv", "scores.csv", "depth_levels.csv")
_PATCHES = "patches.csv"
FIGURES = ("training.png", "depth_levels.png", "patches.png")
_CARD = Path(WEIGHTS).with_suffix(".md").name
_OWN = (_CHECKPOINT, WEIGHTS, _CARD, *_TABLES, _PATCHES, *FIGURES)
#: In bytes; a checkpoint of the thesis's network has 170 MB.
_LARGEST = 2**32
_DIGEST_BYTES = hashlib.sha256().digest_size

Row = dict[str, Any]


@dataclass
class Log:
    """What people read of a training: a row a step, a row a scoring, a row a depth level."""

    losses: list[Row] = field(default_factory=list)
    scores: list[Row] = field(default_factory=list)
    levels: list[Row] = field(default_factory=list)


class TrainingFolder:
    """The files of one training.

    Parameters
    ----------
    path : Path
        The folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def started(self) -> bool:
        """True if there is a checkpoint to continue from."""
        return (self.path / _CHECKPOINT).exists()

    @property
    def foreign(self) -> bool:
        """True if the folder holds files, and none of them is a training's."""
        there = {file.name for file in self.path.iterdir()} if self.path.exists() else set()
        return bool(there) and there.isdisjoint(_OWN)

    @property
    def holds_files(self) -> bool:
        """True if a training left anything here, even only a log."""
        return any((self.path / name).exists() for name in _OWN)

    def clear(self) -> None:
        """Remove the files of an earlier training, and no others."""
        for name in _OWN:
            (self.path / name).unlink(missing_ok=True)

    def save(self, identity: Mapping[str, Any], state: Mapping[str, Any], log: Log) -> None:
        """Write the log as tables for people, then the checkpoint, which holds it too.

        After a kill in between, the tables are ahead of the checkpoint until the next `save`.
        """
        for name, rows in zip(_TABLES, (log.losses, log.scores, log.levels), strict=True):
            _write(self.path / name, rows)
        content = io.BytesIO()
        saved = {"identity": _as_json(identity), "log": vars(log), "state": dict(state)}
        torch.save(saved, content)
        body = content.getvalue()
        write_whole(self.path / _CHECKPOINT, body + hashlib.sha256(body).digest())

    def load(self, identity: Mapping[str, Any]) -> tuple[dict[str, Any], Log]:
        """Return the checkpoint's state and log.

        Raises
        ------
        InputError
            If it is damaged, or of another training; every difference is named.
        """
        path = self.path / _CHECKPOINT
        try:
            content = read_whole(path, _LARGEST)
        except OSError as error:
            what = f"cannot read the checkpoint: {reason_of(error)}"
            raise InputError(what, where=str(path), fix="--fresh starts over") from error
        body, digest = content[:-_DIGEST_BYTES], content[-_DIGEST_BYTES:]
        if hashlib.sha256(body).digest() != digest:
            raise InputError("damaged checkpoint", where=str(path), fix="--fresh starts over")
        saved = torch.load(io.BytesIO(body), weights_only=True)
        problems = [
            Problem(
                f"the checkpoint is of another training, with {name} {one} instead of {other}",
                where=str(path),
                fix="repeat the earlier command, choose another folder with --out, or --fresh",
            )
            for name, one, other in differences(saved["identity"], _as_json(identity))
        ]
        if problems:
            raise InputError.of(problems)
        return saved["state"], Log(**saved["log"])

    def write_patches(self, rows: list[Row]) -> None:
        """Write how often patches were drawn from each pair."""
        _write(self.path / _PATCHES, rows)


def _as_json(identity: Mapping[str, Any]) -> dict[str, Any]:
    # Tuples become lists, so that both sides of a comparison have the same types.
    found: dict[str, Any] = json.loads(json.dumps(identity))
    return found


def _write(path: Path, rows: list[Row]) -> None:
    if not rows:
        path.unlink(missing_ok=True)
        return
    text = io.StringIO()
    names = dict.fromkeys(name for row in rows for name in row)
    writer = csv.DictWriter(text, list(names), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue())
