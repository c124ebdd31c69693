"""A search's folder: what it is of, and a row for each particle that was trained."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dfdbench.errors import InputError, Problem
from dfdbench.system.files import write_whole
from dfdbench.system.json_text import differences, parse_json
from dfdbench.training.search.evaluation import PARTS, Outcome
from dfdbench.training.search.particle import COMPONENTS
from dfdbench.training.search.swarm import Numbers

_IDENTITY = "search.json"
POSITIONS = "positions.csv"
_PARTICLES = "particles"
_SIDES = ("train", "other")
_HEAD = ("iteration", "particle", "objective", "failed", "parameters", "steps", "seconds")
_COLUMNS = (*_HEAD, *(f"{side}_{part}" for side in _SIDES for part in PARTS), *COMPONENTS)

_RESTORE = "put the file back as it was, or start over with --out DIR"
_OTHER = "repeat the earlier command, or choose another folder with --out DIR"

#: Iteration and particle.
Place = tuple[int, int]


@dataclass(frozen=True)
class Row:
    """A position and what its training came to."""

    place: Place
    position: Numbers
    outcome: Outcome


class SearchFolder:
    """Where a search keeps what it goes on from, and what people read.

    Parameters
    ----------
    path : Path
        The folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._rows: dict[Place, Row] = {}

    def open(self, identity: Mapping[str, Any]) -> None:
        """Begin, or read what was done before.

        Raises
        ------
        InputError
            If the folder holds another search or other files, or rows of the log cannot be read.
        """
        now = json.loads(json.dumps(identity))
        file = self.path / _IDENTITY
        if not file.exists():
            if self.path.exists() and any(self.path.iterdir()):
                what = "the folder holds something else than a search"
                raise InputError(what, where=str(self.path), fix=_OTHER)
            write_whole(file, json.dumps(now, indent=2) + "\n")
        problems = [
            Problem(
                f"the folder holds another search, with {name} {one} instead of {other}",
                where=str(file),
                fix=_OTHER,
            )
            for name, one, other in differences(_read_identity(file), now)
        ]
        if problems:
            raise InputError.of(problems)
        log = self.path / POSITIONS
        rows = _read_rows(log) if log.exists() else []
        self._rows = {row.place: row for row in rows}
        # Without the line that a kill may have cut short.
        write_whole(log, _as_csv(rows, header=True))

    def __getitem__(self, place: Place) -> Row | None:
        """Return what is known of a particle in an iteration."""
        return self._rows.get(place)

    def __len__(self) -> int:
        """Return how many trainings are known."""
        return len(self._rows)

    def note(self, row: Row) -> None:
        """Keep what a training came to: once this returns, a kill does not lose it."""
        self._rows[row.place] = row
        with (self.path / POSITIONS).open("a", encoding="utf-8") as file:
            file.write(_as_csv([row], header=False))
            file.flush()
            os.fsync(file.fileno())

    def training(self, place: Place) -> Path:
        """Return the folder that a particle is trained in."""
        return self.path / _PARTICLES / f"{place[0]:03}-{place[1]:03}"

    def forget(self, places: Iterable[Place]) -> None:
        """Remove trainings: their weights would fill disks."""
        for place in places:
            shutil.rmtree(self.training(place), ignore_errors=True)

    def require_same(self, place: Place, position: Numbers) -> None:
        """Refuse a log whose position is not the one that the search comes to.

        Raises
        ------
        InputError
            If it is another.
        """
        row = self._rows.get(place)
        if row is None or np.array_equal(row.position, position):
            return
        number = int(np.flatnonzero(row.position != position)[0])
        got, wanted = row.position[number], position[number]
        where = f"{self.path / POSITIONS}: iteration {place[0]}, particle {place[1]}"
        what = f"{COMPONENTS[number]} is {got}, but this search comes to {wanted}"
        raise InputError(what, where=where, fix=_RESTORE)


def _read_identity(file: Path) -> dict[str, Any]:
    try:
        content = parse_json(file.read_bytes())
    except ValueError as error:
        raise InputError(
            f"the search's record cannot be read: {error}", where=str(file), fix=_RESTORE
        ) from error
    return content if isinstance(content, dict) else {}


def _read_rows(log: Path) -> list[Row]:
    try:
        lines = log.read_bytes().decode("utf-8").split("\n")
    except UnicodeDecodeError as error:
        raise InputError.of(_damaged("the log is no text", str(log), str(error))) from error
    found: dict[Place, Row] = {}
    problems: list[Problem] = []
    # What follows the last line break is empty, or was cut short by a kill.
    for number, values in enumerate(csv.DictReader(lines[:-1]), 2):
        where = f"{log}: line {number}"
        try:
            row = _row_of(values)
        except (ValueError, TypeError, KeyError) as error:
            problems.append(_damaged("a row of the log cannot be read", where, str(error)[:100]))
            continue
        if found.setdefault(row.place, row) is not row:
            got = f"iteration {row.place[0]}, particle {row.place[1]} once more"
            problems.append(_damaged("a training is in the log twice", where, got))
    if problems:
        raise InputError.of(problems)
    return list(found.values())


def _damaged(what: str, where: str, got: str) -> Problem:
    fix = "put the line back as it was, or remove it: the particle is then trained anew"
    return Problem(what, where=where, got=got, fix=fix)


def _row_of(values: Mapping[str, str]) -> Row:
    if None in values or None in values.values():
        raise ValueError(f"not {len(_COLUMNS)} values")
    scores = [
        {part: float(values[f"{side}_{part}"]) for part in PARTS if values[f"{side}_{part}"]}
        for side in _SIDES
    ]
    value = float(values["objective"])
    if math.isnan(value):
        raise ValueError("objective: no number")
    outcome = Outcome(
        value,
        values["failed"],
        scores[0],
        scores[1],
        int(values["parameters"]),
        int(values["steps"]),
        float(values["seconds"]),
    )
    position = np.array([float(values[name]) for name in COMPONENTS])
    return Row((int(values["iteration"]), int(values["particle"])), position, outcome)


def _as_csv(rows: Iterable[Row], header: bool) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if header:
        writer.writerow(_COLUMNS)
    for row in rows:
        outcome = row.outcome
        scores = [side.get(part, "") for side in (outcome.train, outcome.other) for part in PARTS]
        failed = " ".join(outcome.failed.split())
        work = (outcome.parameters, outcome.steps, outcome.seconds)
        writer.writerow((*row.place, outcome.value, failed, *work, *scores, *row.position.tolist()))
    return text.getvalue()
