"""A training's folder: what it is of, its log, and a checkpoint to go on from."""

from __future__ import annotations

import csv
import io
import json
import pickle
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from dfdbench.errors import InputError, Problem
from dfdbench.system.files import require_file, write_whole
from dfdbench.system.json_text import differences, parse_json
from dfdbench.training.saved_numbers import whole_number
from dfdbench.training.saved_tensors import require_plain_archive

#: Of the checkpoint's layout.
VERSION = 1
WEIGHTS = "weights.safetensors"
_CHECKPOINT = "checkpoint.pt"
_LOSSES = "losses.csv"
_SCORES = "scores.csv"
_LEVELS = "depth_levels.csv"
TRAINING_FIGURE = "training.png"
LEVELS_FIGURE = "depth_levels.png"
PATCHES = "patches.csv"
PATCHES_FIGURE = "patches.png"
_OWN = (
    _CHECKPOINT,
    WEIGHTS,
    Path(WEIGHTS).with_suffix(".md").name,
    _LOSSES,
    _SCORES,
    _LEVELS,
    TRAINING_FIGURE,
    LEVELS_FIGURE,
    PATCHES,
    PATCHES_FIGURE,
)
#: What reading a damaged checkpoint comes to, by where it is damaged.
DAMAGED = (
    pickle.UnpicklingError,
    RuntimeError,
    EOFError,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    OSError,
    zipfile.BadZipFile,
)
#: Of a step, at most: Python reads no number of thousands.
_DIGITS = 18
#: The columns of a log that have a number in every row.
_NEEDED = {_LOSSES: ("step", "learning_rate", "loss"), _SCORES: ("step",)}

Row = dict[str, Any]


@dataclass
class Log:
    """What a training wrote down: a loss for each step, scores now and then."""

    losses: list[Row] = field(default_factory=list)
    scores: list[Row] = field(default_factory=list)


class TrainingFolder:
    """Where a training keeps what it needs to go on, and what people read.

    Parameters
    ----------
    path : Path
        The folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def started(self) -> bool:
        """True where there is something to go on from."""
        return (self.path / _CHECKPOINT).exists()

    @property
    def foreign(self) -> bool:
        """True where there is something, and none of it is a training's."""
        there = {file.name for file in self.path.iterdir()} if self.path.exists() else set()
        return bool(there) and there.isdisjoint(_OWN)

    @property
    def holds_files(self) -> bool:
        """True where a training left anything, if only a log."""
        return any((self.path / name).exists() for name in _OWN)

    def clear(self) -> None:
        """Remove what an earlier training left; other files are not touched."""
        for name in _OWN:
            (self.path / name).unlink(missing_ok=True)

    def save(self, identity: Mapping[str, Any], state: Mapping[str, Any], new: Log) -> None:
        """Add to the log, then put the new checkpoint in place of the old one.

        Killed in between, the log has rows too many: `load` leaves them out.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        for name, rows in ((_LOSSES, new.losses), (_SCORES, new.scores)):
            _append(self.path / name, rows)
        content = io.BytesIO()
        torch.save({"version": VERSION, "identity": json.dumps(identity), **state}, content)
        write_whole(self.path / _CHECKPOINT, content.getvalue())

    def load(self, identity: Mapping[str, Any]) -> dict[str, Any]:
        """Return the state of the checkpoint; cut the log to its step.

        Raises
        ------
        InputError
            Where it cannot be read, or is of another training; what differs is named.
        """
        state = self._state()
        path = self.path / _CHECKPOINT
        try:
            step, before = whole_number(state, "step"), parse_json(state["identity"])
            if not isinstance(before, dict):
                raise TypeError("it does not say of which training it is")
        except DAMAGED as error:
            raise self.unreadable(error) from error
        now = json.loads(json.dumps(identity))
        problems = [
            Problem(
                "the checkpoint is of another training",
                where=f"{path}: {name}",
                expected=str(one),
                got=str(other),
                fix="ask for the same again, choose another folder with --out, or --fresh",
            )
            for name, one, other in differences(before, now)
        ]
        if problems:
            raise InputError.of(problems)
        for name, needed in _NEEDED.items():
            file = self.path / name
            rows = _up_to(step, _read(file), needed, str(file))
            if name == _LOSSES and len(rows) != step:
                raise _damaged_log(str(file), f"{len(rows):,} of the checkpoint's {step:,} steps")
            _write(file, rows)
        return state

    def _state(self) -> dict[str, Any]:
        path = self.path / _CHECKPOINT
        try:
            require_file(path)
            require_plain_archive(path)
            state = dict(torch.load(path, weights_only=True))
            version = whole_number(state, "version")
        except DAMAGED as error:
            raise self.unreadable(error) from error
        if version != VERSION:
            raise InputError(
                "a checkpoint of another version",
                where=str(path),
                expected=str(VERSION),
                got=str(version),
                fix="go on with the dfdbench that wrote it, or --fresh starts anew",
            )
        return state

    def unreadable(self, error: Exception) -> InputError:
        """Return the error for a checkpoint that is damaged, or holds another network's state."""
        return InputError(
            "the checkpoint cannot be read",
            where=str(self.path / _CHECKPOINT),
            got=_said(error),
            fix="--fresh starts anew",
        )

    def log(self) -> Log:
        """Return all that the log holds."""
        return Log(_read(self.path / _LOSSES), _read(self.path / _SCORES))

    def write_levels(self, trained: Iterable[int], present: Iterable[int]) -> None:
        """Write how often each depth level was trained on, and occurs in the training pairs."""
        rows: list[Row] = [
            {"level": level, "trained": int(count), "present": int(there)}
            for level, (count, there) in enumerate(zip(trained, present, strict=True))
        ]
        _write(self.path / _LEVELS, rows)

    def levels(self) -> list[Row]:
        """Return what `write_levels` wrote."""
        return _read(self.path / _LEVELS)

    def write_patches(self, rows: list[Row]) -> None:
        """Write how often patches were drawn from each pair."""
        _write(self.path / PATCHES, rows)


def _said(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"no {error}"
    return str(error).partition("\n")[0][:100] or "no content"


def _up_to(step: int, rows: list[Row], needed: tuple[str, ...], where: str) -> list[Row]:
    # A row cut short by a kill may read as an earlier step: steps only grow.
    kept: list[Row] = []
    if rows and not rows[0].keys() >= set(needed):
        raise _damaged_log(where, f"a heading {','.join(map(str, rows[0]))}"[:100])
    for row in rows:
        last = int(kept[-1]["step"]) if kept else -1
        whole = None not in row.values() and None not in row and row["step"].isdigit()
        if whole and last < int(row["step"][:_DIGITS]) <= step:
            kept.append(row)
    for row in kept:
        for name, value in row.items():
            try:
                float(value if name in needed else value or 0)
            except ValueError as error:
                raise _damaged_log(where, f"{name} {value}"[:100]) from error
    return kept


def _damaged_log(where: str, got: str) -> InputError:
    return InputError(
        "the log of the training cannot be read",
        where=where,
        got=got,
        fix="put it back as it was, or --fresh starts anew",
    )


def _as_csv(rows: list[Row], header: bool) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    if header:
        writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _append(path: Path, rows: list[Row]) -> None:
    if rows:
        with path.open("a", encoding="utf-8") as file:
            file.write(_as_csv(rows, header=file.tell() == 0))


def _write(path: Path, rows: list[Row]) -> None:
    if rows:
        write_whole(path, _as_csv(rows, header=True))
    else:
        path.unlink(missing_ok=True)


def _read(path: Path) -> list[Row]:
    if not path.exists():
        return []
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))
    except (ValueError, csv.Error) as error:
        raise _damaged_log(str(path), str(error)[:100]) from error
