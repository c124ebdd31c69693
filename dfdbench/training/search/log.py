"""Train and score the networks of a search, and keep a log."""

import csv
import io
import json
import math
import os
import shutil
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from dfdbench.errors import InputError, MethodError
from dfdbench.methods.networks.weights import load_weights
from dfdbench.metrics.protocol import Protocol, find_protocol
from dfdbench.system.files import whole_files, write_whole
from dfdbench.system.text import parse_json, require_same
from dfdbench.training.learner import Learner
from dfdbench.training.search.particle import COMPONENTS, Numbers, Swarm, particle_at
from dfdbench.training.search.search_plan import SearchPlan
from dfdbench.training.task import Task, evenly_spaced, mean_scores
from dfdbench.training.trainer import DivergedError, train

#: Steps between intermediate scores, which nobody looks at in thousands of trainings.
_NEVER = 10**9
_IDENTITY = "search.json"
POSITIONS = "positions.csv"
_PARTICLES = "particles"
#: The parts of the objective.
PARTS = ("nrmse", "nmae", "ssim")
_HEAD = ("iteration", "particle", "objective", "failed", "parameters", "steps", "seconds")
_SCORES = tuple(f"{side}_{part}" for side in ("train", "other") for part in PARTS)
_COLUMNS = (*_HEAD, *_SCORES, *COMPONENTS)
_RESTORE = "put the file back as it was, or start over with --out DIR"
_OTHER = "repeat the earlier command, or choose another folder with --out DIR"
#: Iteration and particle.
Place = tuple[int, int]


@dataclass(frozen=True)
class LogRow:
    """A position, and the result of its training.

    Parameters
    ----------
    place : tuple of int
        Iteration and particle.
    position : ndarray of float64, shape (components,)
        The particle's position.
    objective : float
        What the search minimises; infinite if the training failed.
    failed : str
        Why it failed; empty if it did not.
    parameters, steps : int
        Parameters of the network, steps of the training.
    seconds : float
        Time spent training.
    scores : dict
        Means on the training pairs, ``train_nrmse`` and so on, and on the others, ``other_nrmse``.
    """

    place: Place
    position: Numbers
    objective: float = math.inf
    failed: str = ""
    parameters: int = 0
    steps: int = 0
    seconds: float = 0.0
    scores: dict[str, float] = field(default_factory=dict)


class SearchFolder:
    """A search's folder: what it needs to continue, and what people read.

    Parameters
    ----------
    path : Path
        The folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        #: The known results of trainings.
        self.rows: dict[Place, LogRow] = {}

    def open(self, identity: Mapping[str, Any]) -> None:
        """Start a search, or read an earlier one.

        Raises
        ------
        InputError
            If the folder holds another search or other files, or rows of the log cannot be read.
        """
        file = self.path / _IDENTITY
        if not file.exists():
            if whole_files(self.path):
                what = "the folder holds something other than a search"
                raise InputError(what, where=str(self.path), fix=_OTHER)
            write_whole(file, json.dumps(identity, indent=2) + "\n")
        what = "the folder holds another search"
        require_same(_read_identity(file), identity, what, str(file), _OTHER)
        log = self.path / POSITIONS
        self.rows = _read_rows(log, float(identity["gamma"])) if log.exists() else {}
        # Drop a last line that a kill may have cut short.
        write_whole(log, _as_csv(self.rows.values(), header=True))

    def note(self, row: LogRow) -> None:
        """Save a training's result: once this returns, a kill does not lose it."""
        self.rows[row.place] = row
        with (self.path / POSITIONS).open("a", encoding="utf-8") as file:
            file.write(_as_csv([row], header=False))
            file.flush()
            os.fsync(file.fileno())

    def forget(self, places: Iterable[Place]) -> None:
        """Remove trainings, because their weights would fill the disk."""
        for place in places:
            shutil.rmtree(training_folder(self.path, place), ignore_errors=True)

    def rows_of(self, swarm: Swarm) -> list[LogRow]:
        """Return the known results for a swarm's positions, in order.

        Raises
        ------
        InputError
            If a position in the log differs from the search's.
        """
        rows = []
        for number, position in enumerate(swarm.positions):
            if row := self.rows.get((swarm.iteration, number)):
                self._require_same(row, position)
                rows.append(row)
        return rows

    def _require_same(self, row: LogRow, position: Numbers) -> None:
        if np.array_equal(row.position, position):
            return
        number = int(np.flatnonzero(row.position != position)[0])
        got, wanted = row.position[number], position[number]
        where = f"{self.path / POSITIONS}: iteration {row.place[0]}, particle {row.place[1]}"
        what = f"{COMPONENTS[number]} is {got}, but this search comes to {wanted}"
        raise InputError(what, where=where, fix=_RESTORE)


def training_folder(search: Path, place: Place) -> Path:
    """Return the folder in which a particle is trained."""
    return search / _PARTICLES / f"{place[0]:03}-{place[1]:03}"


def _read_identity(file: Path) -> dict[str, Any]:
    try:
        content = parse_json(file.read_bytes())
    except ValueError as error:
        what = f"the search's record cannot be read: {error}"
        raise InputError(what, where=str(file), fix=_RESTORE) from error
    return content if isinstance(content, dict) else {}


def _read_rows(log: Path, gamma: float) -> dict[Place, LogRow]:
    found: dict[Place, LogRow] = {}
    where = str(log)
    try:
        # The rest after the last line break is empty, or was cut short by a kill.
        lines = log.read_text("utf-8").split("\n")[:-1]
        for number, values in enumerate(csv.DictReader(lines), 2):
            where = f"{log}: line {number}"
            row = _row_of(values)
            if found.setdefault(row.place, row) is not row:
                raise ValueError(f"particle {row.place[1]} of iteration {row.place[0]} twice")
            if not math.isclose(row.objective, value := objective(row.scores, gamma)):
                raise ValueError(f"objective {row.objective:g}, and {value:g} by its scores")
    except (ValueError, TypeError, KeyError) as error:
        what = f"the log cannot be read: {str(error)[:100]}"
        fix = "put the line back as it was, or remove it: the particle is then trained anew"
        raise InputError(what, where=where, fix=fix) from error
    return found


def _row_of(values: Mapping[str, str]) -> LogRow:
    if None in values or None in values.values():
        raise ValueError(f"not {len(_COLUMNS)} values")
    objective = float(values["objective"])
    if math.isnan(objective):
        raise ValueError("objective: no number")
    return LogRow(
        (int(values["iteration"]), int(values["particle"])),
        np.array([float(values[name]) for name in COMPONENTS]),
        objective,
        values["failed"],
        int(values["parameters"]),
        int(values["steps"]),
        float(values["seconds"]),
        {name: float(values[name]) for name in _SCORES if values[name]},
    )


def _as_csv(rows: Iterable[LogRow], header: bool) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if header:
        writer.writerow(_COLUMNS)
    for row in rows:
        failed = " ".join(row.failed.split())
        work = (row.objective, failed, row.parameters, row.steps, row.seconds)
        scores = [row.scores.get(name, "") for name in _SCORES]
        writer.writerow((*row.place, *work, *scores, *row.position.tolist()))
    return text.getvalue()


#: The centre of an image, all that the thesis's author scores in his search; errors are over 255.
CENTRE = (368, 400)
OF_CENTRE = Protocol(
    "search", 1, "all", "255", "whole", "the search published with the thesis's networks"
)


def objective(scores: Mapping[str, float], gamma: float) -> float:
    """Return Eq. 6.1: NMAE + NRMSE + 1 - SSIM, over two sets; infinite if one is undefined.

    Parameters
    ----------
    scores : mapping
        As in a `LogRow`.
    gamma : float
        The weight of the training pairs, 0 to 1.

    Examples
    --------
    >>> good = dict(train_nrmse=0.1, train_nmae=0.1, train_ssim=0.8)
    >>> poor = dict(other_nrmse=0.2, other_nmae=0.2, other_ssim=0.4)
    >>> round(objective({**good, **poor}, 0.3), 3), objective(good, 0.3)
    (0.82, inf)
    """
    if not all(math.isfinite(scores.get(name, math.nan)) for name in _SCORES):
        return math.inf
    return sum(
        weight * (scores[f"{side}_nmae"] + scores[f"{side}_nrmse"] + 1 - scores[f"{side}_ssim"])
        for side, weight in (("train", gamma), ("other", 1 - gamma))
    )


class TimeUpError(Exception):
    """Time is up before the work is done."""


@dataclass(frozen=True)
class Evaluation:
    """Train particles' networks and score them; it can be sent to other processes.

    Parameters
    ----------
    plan : SearchPlan
        The search.
    folder : Path
        The search's folder.
    device : str
        As in `dfdbench.training.learner.Learner`.
    threads : int or None
        Processor threads of each training; None keeps PyTorch's choice.
    until : float
        The time, in seconds since 1970, at which trainings stop wherever they are.
    """

    plan: SearchPlan
    folder: Path
    device: str = "auto"
    threads: int | None = None
    until: float = math.inf

    def __call__(self, particle: tuple[Place, Numbers]) -> LogRow | None:
        """Train and score a particle, given its place and position; return None if time was up.

        A training that diverges, or that the machine cannot do, counts as failed. Errors of the
        disk or the data set are raised, because they say nothing about the network.

        Raises
        ------
        ResultError
            If another process is running the same training.
        """
        if self.threads is not None:
            torch.set_num_threads(self.threads)
        try:
            return self._trained_and_scored(*particle)
        except TimeUpError:
            return None
        except (DivergedError, MethodError) as error:
            # The last step may break the weights after a loss that was still finite.
            why = f"diverged: {error.problems[0].what}, {error.problems[0].where}"
        except (MemoryError, RuntimeError) as error:
            # PyTorch raises RuntimeError for whatever it cannot do, including too little memory on
            # a card.
            text = str(error).partition("\n")[0][:200]
            why = f"failed: {text or type(error).__name__}"
        return LogRow(*particle, failed=why)

    def _trained_and_scored(self, place: Place, position: Numbers) -> LogRow:
        plan, store, choices = self.plan, self.plan.store, self.plan.choices
        self._stop_in_time()
        configuration = plan.configuration_of(particle_at(position))
        configuration = configuration.model_copy(update={"evaluate_every": _NEVER})
        # A separate key, because the swarm draws from the same numbers.
        seeds = np.random.SeedSequence((choices.seed, *place), spawn_key=(1,))
        seed = int(seeds.generate_state(1)[0])
        every = store.pairs("all")
        sides = {
            side: tuple(pair for pair in every if pair.scene in scenes)
            for side, scenes in (("train", plan.train), ("other", plan.other))
        }
        task = Task("dfd-net", store, sides["train"], (), plan.trained_on, "", configuration, seed)
        learner, folder = Learner(task, self.device), training_folder(self.folder, place)
        weights, card, _ = train(learner, folder, None, lambda *_: self._stop_in_time())
        network = load_weights(weights, "dfd-net")[0]
        protocol, centre = (OF_CENTRE, CENTRE) if plan.author else (find_protocol("thesis"), None)
        scores: dict[str, float] = {}
        for side, pairs in sides.items():
            scored = pairs if choices.pairs is None else evenly_spaced(pairs, choices.pairs)
            how = learner.device, configuration.readout, [protocol], centre
            means = mean_scores(network, store, scored, *how)[protocol.label]
            scores |= {f"{side}_{name}": means[name] for name in PARTS if name in means}
        value = objective(scores, choices.gamma)
        failed = "" if math.isfinite(value) else "failed: its scores are not defined"
        work = card.parameters, card.steps, card.seconds
        return LogRow(place, position, value, failed, *work, scores)

    def _stop_in_time(self) -> None:
        if time.time() >= self.until:
            raise TimeUpError
