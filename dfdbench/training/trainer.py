"""Train a network: steps, scores, checkpoints, and what a training folder holds."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import torch

from dfdbench.datasets.manifest import Pair
from dfdbench.errors import InputError, ResultError, reason_of, room_or
from dfdbench.methods.networks.inference import find_device
from dfdbench.methods.networks.weights import Card, count_parameters, save_weights
from dfdbench.results.environment import describe_environment
from dfdbench.system.files import read_as, write_whole
from dfdbench.system.packages import PACKAGE_VERSION
from dfdbench.system.text import require_same
from dfdbench.training.configuration import settled
from dfdbench.training.crops import Cropper
from dfdbench.training.learner import EndedBy, Learner
from dfdbench.training.task import PROTOCOL, Task, evenly_spaced, mean_scores, same_threads

_SAVE_SECONDS = 60.0


@dataclass(frozen=True)
class TrainingOutcome:
    """The results of `train`: the file of weights, its card, the log, and what drew the patches."""

    weights: Path
    card: Card
    log: Log
    cropper: Cropper

    @property
    def within_warm_up(self) -> bool:
        """True if time was up before the learning rate had reached its maximum."""
        return EndedBy.of(self.card.ended_by) is EndedBy.TIME_LIMIT_IN_WARM_UP


def train(
    task: Task,
    folder: Path,
    max_seconds: float | None = None,
    device: str = "auto",
    on_step: Callable[[int, int | None], None] | None = None,
    fresh: bool = False,
) -> TrainingOutcome:
    """Train until the schedule ends or time is up, from the folder's checkpoint if it has one.

    Parameters
    ----------
    task : Task
        What is trained.
    folder : Path
        Where checkpoint, log and weights go.
    max_seconds : float, optional
        The most time to spend on training, earlier calls included.
    device : str
        As for the methods: ``auto``, ``cpu``, ``cuda``, ``mps``.
    on_step : callable, optional
        Called with (steps done, steps in all if known).
    fresh : bool
        Remove an earlier training from the folder, once everything is checked.

    Raises
    ------
    InputError
        If choices do not fit each other, or the checkpoint is damaged or of another training.
    ResultError
        If the folder cannot be written.

    Notes
    -----
    On a CPU, with the same number of threads, an interrupted and resumed training has the same
    losses, bit for bit, as an uninterrupted one.
    """
    found = find_device(device)
    # Checkpoint and card keep the settled precision: on another machine `auto` may differ.
    task = replace(task, configuration=settled(task.configuration, found))
    session = _Session(task, TrainingFolder(folder), found, fresh)
    try:
        return session.run(max_seconds, on_step)
    except OSError as error:
        fix = room_or("choose another place with --out DIR; --resume goes on", error)
        what = f"cannot write the training: {reason_of(error)}"
        raise ResultError(what, where=str(folder), fix=fix) from error


class _Session:
    """Decide when a learner is saved, scored and stopped."""

    def __init__(
        self, task: Task, folder: TrainingFolder, device: torch.device, fresh: bool
    ) -> None:
        self._task = task
        self._folder = folder
        self._device = device
        self._fresh = fresh
        self._learner = Learner(task, device)
        self._seconds = 0.0
        self._log = Log()
        if folder.started and not fresh:
            state, self._log = folder.load(task.identity)
            self._seconds = state.pop("seconds")
            self._learner.restore(state)

    def run(
        self, max_seconds: float | None, on_step: Callable[[int, int | None], None] | None
    ) -> TrainingOutcome:
        choices = self._task.configuration
        begin = time.monotonic() - self._seconds
        saved = time.monotonic()
        if self._fresh:
            self._folder.clear()
        if self._learner.step == 0:
            # Report a folder that cannot be written now, not after the first minute.
            self._save()
        ended = self._ended(max_seconds)
        while not ended:
            self._one_step()
            if on_step:
                on_step(self._learner.step, choices.steps)
            if self._learner.step % choices.evaluate_every == 0:
                self._note_scores()
            now = time.monotonic()
            self._seconds = now - begin
            ended = self._ended(max_seconds)
            if ended or now - saved >= _SAVE_SECONDS:
                self._save()
                saved = now
        return self._finish(ended)

    def _ended(self, max_seconds: float | None) -> str:
        """Return why training has ended, in the words of the card, or an empty text."""
        ended = self._learner.schedule.ended
        if ended or max_seconds is None or self._seconds < max_seconds:
            return ended
        choices, step = self._task.configuration, self._learner.step
        if choices.schedule != "cosine" or step >= choices.warm_up:
            return EndedBy.TIME_LIMIT
        return f"{EndedBy.TIME_LIMIT_IN_WARM_UP}, at step {step:,} of {choices.warm_up:,}"

    def _one_step(self) -> None:
        rate = self._learner.schedule.rate
        loss = self._learner.learn()
        self._log.losses.append({"step": self._learner.step, "learning_rate": rate, "loss": loss})

    def _note_scores(self) -> None:
        row: dict[str, Any] = {"step": self._learner.step}
        for name, pairs in (("train", self._task.train), ("test", self._task.test)):
            chosen = evenly_spaced(pairs, self._task.configuration.evaluate_pairs)
            for protocol, scores in self._mean_scores(chosen).items():
                kind = name if protocol == PROTOCOL else f"{name}_{protocol}"
                row |= {f"{kind}_{metric}": value for metric, value in scores.items()}
        self._log.scores.append(row)

    def _mean_scores(self, pairs: Sequence[Pair]) -> dict[str, dict[str, float]]:
        readout = self._task.configuration.readout
        store, device = self._task.store, self._device
        return mean_scores(self._learner.network, store, pairs, device, readout=readout)

    def _save(self) -> None:
        state = {**self._learner.state(), "seconds": self._seconds}
        counts = zip(self._learner.trained, self._learner.present, strict=True)
        self._log.levels = [
            {"level": level, "trained": int(trained), "present": int(present)}
            for level, (trained, present) in enumerate(counts)
        ]
        self._folder.save(self._task.identity, state, self._log)

    def _finish(self, ended: str) -> TrainingOutcome:
        task = self._task
        scores = self._mean_scores(task.test)
        with same_threads():
            environment = describe_environment()
        card = Card(
            method=task.method,  # type: ignore[arg-type]
            architecture=self._learner.architecture,
            parameters=count_parameters(self._learner.network),
            trained_on=task.trained_on,
            started_from=self._learner.started_from,
            dataset=task.store.manifest.stem,
            fingerprint=task.store.fingerprint,
            recipe=task.store.recipe_name,
            configuration=task.configuration.model_dump(mode="json"),
            seed=task.seed,
            steps=self._learner.step,
            seconds=round(self._seconds, 1),
            ended_by=ended,
            scored_on=f"{task.tested_on}, {len(task.test)} pairs" if task.test else "nothing",
            scores=scores.pop(PROTOCOL),
            further_scores=scores,
            environment={
                "processor": environment.gpu or environment.cpu,
                "threads": str(torch.get_num_threads()),
                "torch": str(torch.__version__),
                "dfdbench": PACKAGE_VERSION,
            },
        )
        path = self._folder.path / WEIGHTS
        save_weights(path, self._learner.network, card)
        return TrainingOutcome(path, card, self._log, self._learner.cropper)


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
        fix = "--fresh starts over"
        content = read_as(InputError, path, "the checkpoint", _LARGEST, fix)
        body, digest = content[:-_DIGEST_BYTES], content[-_DIGEST_BYTES:]
        if hashlib.sha256(body).digest() != digest:
            raise InputError("damaged checkpoint", where=str(path), fix=fix)
        saved = torch.load(io.BytesIO(body), weights_only=True)
        fix = "repeat the earlier command, choose another folder with --out, or --fresh"
        what = "the checkpoint is of another training"
        require_same(saved["identity"], _as_json(identity), what, str(path), fix)
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
