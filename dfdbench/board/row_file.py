"""A row of the leaderboard: a method's runs on one split of a data set, in one file."""

import functools
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import Field, JsonValue, TypeAdapter, ValidationError, model_validator

from dfdbench.audit.leaks import scenes_seen
from dfdbench.blur.tracks import CLEAN, STACKS, SUITES, TRACKS
from dfdbench.board import LEADERBOARD
from dfdbench.board.cards import Card
from dfdbench.datasets.catalog import AT, find_manifest, released_headings
from dfdbench.datasets.manifest import Manifest, Name, Pair
from dfdbench.datasets.rendered import seeded
from dfdbench.errors import DfdbenchError, Problem, ResultError, unknown_name
from dfdbench.methods.registry import built_in_methods, registered_methods
from dfdbench.metrics.protocol import RELEASED, VALID, metrics_of
from dfdbench.results import record, wording
from dfdbench.system.files import read_as, read_whole, shipped
from dfdbench.system.strict import Record, problems_of
from dfdbench.tables.table import listed

_T = TypeVar("_T")
_R = TypeVar("_R", bound=Record)
_Fingerprints = TypeAdapter(dict[str, list[str]])
RESULTS = "results"
#: The fingerprints that a data set must have if it is made the same everywhere.
FINGERPRINTS = "fingerprints.json"
# What may differ between runs of one method; the rest of its record is the row's.
_OF_RUN = {"uses", "trained_on", "fitted_on", "fit_seconds", "chosen", "source_sha256", "paper"}
_TRACKS = (*TRACKS.values(), *STACKS.values())
_LABELS = (CLEAN, *(label for track in _TRACKS for label in track.labels))


def leaderboard_folder() -> Path:
    """Return ``leaderboard`` in the working directory, a clone's root; elsewhere what is shipped.

    Examples
    --------
    >>> (leaderboard_folder() / "methods" / "constant.toml").is_file()
    True
    """
    return LEADERBOARD if LEADERBOARD.is_dir() else shipped("rows")


class RowRun(Record):
    """A run on clean images or on a track at a severity.

    Lists have a place for each of the row's pairs, null if it was not evaluated. `method` and
    `environment` hold what differs from the row's; of the method, only what each run finds anew. If
    the run went on elsewhere, `machine` says for each pair where: 0 for `environment`, then
    `other_environments`. `answered` is the share of each pair's pixels that have an answer, empty
    where all have. `scores` are by protocol and metric.
    """

    label: Annotated[str, Field(json_schema_extra={"enum": list(_LABELS)})]
    fingerprint: record.Sha256
    recipe: record.RecipeRecord
    options: dict[str, JsonValue] = Field(default_factory=dict)
    method: dict[str, JsonValue] = Field(default_factory=dict)
    environment: dict[str, JsonValue] = Field(default_factory=dict)
    other_environments: list[record.Environment] = Field(default_factory=list)
    machine: list[record.Count] = Field(default_factory=list)
    status: list[Literal["ok", "failed", "missing", "not-run"]]
    timed_alone: bool = True
    seconds: list[record.Seconds | None]
    prediction_sha256: list[record.Sha256 | None]
    answered: list[record.Share] = Field(default_factory=list)
    scores: dict[Name, dict[Name, list[record.Finite | None]]]
    numbers: dict[str, list[record.Number | None]] = Field(default_factory=dict)
    warnings: list[str] = Field(default_factory=list)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.label not in _LABELS:
            raise ValueError(f"no such run: {self.label}")
        if max(self.machine, default=0) > len(self.other_environments):
            raise ValueError(f"{self.label}: a pair was run on a machine that is not listed")
        for protocol, columns in self.scores.items():
            if protocol not in RELEASED:
                raise ValueError(f"{self.label}: no such protocol: {protocol}")
            scored = {name: [v for v in each if v is not None] for name, each in columns.items()}
            for end in (min, max):
                record.by_metric({name: end(v, default=None) for name, v in scored.items()})
        return self

    def records(
        self, pairs: Sequence[Pair], names: Sequence[str], places: Sequence[dict[str, int]]
    ) -> list[record.PairResult]:
        """Return what became of each pair. The lists were checked, so this does not check again."""
        return [
            record.PairResult.model_construct(
                id=names[at],
                scene=pair.scene,
                coordinates=places[at],
                status=self.status[at],
                seconds=self.seconds[at],
                timed_alone=self.timed_alone,
                machine=self.machine[at] if self.machine else 0,
                prediction_sha256=self.prediction_sha256[at],
                answered=self.answered[at] if self.answered else 1.0,
                regions={},  # what is left out is looked up anew each time
                scores={
                    label: {name: column[at] for name, column in columns.items()}
                    for label, columns in self.scores.items()
                    if self.status[at] == "ok"
                },
                numbers={
                    k: v for k, values in self.numbers.items() if (v := values[at]) is not None
                },
                error=None,
                warnings=[],
            )
            for at, pair in enumerate(pairs)
        ]

    def columns(self) -> Iterator[tuple[str, Sequence[object]]]:
        """Yield the lists that have a place for each pair, with their names."""
        yield from (("seconds", self.seconds), ("prediction_sha256", self.prediction_sha256))
        yield from self.numbers.items()
        for protocol, columns in self.scores.items():
            yield from ((f"{protocol}, {name}", column) for name, column in columns.items())


class Row(Record):
    """A method's runs on one split of a data set and on its tracks.

    `dataset` is the name without a track. `suites` are the rankings that the row stands in:
    ``clean``, and suites of tracks such as ``tracks-1``. `pairs` are names, in the manifest's
    order. Means, scenes and coordinates follow from these and the manifest.
    """

    schema_version: Literal[1]
    dataset: Name
    manifest_sha256: record.Sha256
    split: Name
    suites: Annotated[list[str], Field(min_length=1)]
    method: record.MethodRecord
    environment: record.Environment
    seed: record.Seed
    pairs: Annotated[list[str], Field(min_length=1)]
    runs: Annotated[list[RowRun], Field(min_length=1)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if unknown := set(self.suites) - {CLEAN, *SUITES}:
            raise ValueError(f"no such suite: {', '.join(sorted(unknown))}")
        # Without these a row could choose what is averaged.
        needed = {"prediction_sha256"} if self.method.scored else {"prediction_sha256", "seconds"}
        taken: set[tuple[str, str]] = set()
        for run in self.runs:
            self._require_records(run)
            whole: list[tuple[str, Sequence[object]]] = [
                ("status", run.status),
                ("machine", run.machine or run.status),
                ("answered", run.answered or run.status),
            ]
            for name, column in (*whole, *run.columns()):
                if len(column) != len(self.pairs):
                    count = f"{len(column)} places for {len(self.pairs)} pairs"
                    raise ValueError(f"{run.label}: {name} has {count}")
            left_out = [at for at, status in enumerate(run.status) if status != "ok"]
            for name, column in run.columns():
                if any(column[at] is not None for at in left_out):
                    raise ValueError(f"{run.label}: {name} of a pair that was not evaluated")
                if name in needed and column.count(None) > len(left_out):
                    raise ValueError(f"{run.label}: an evaluated pair has no {name}")
            for key in ((run.label, protocol) for protocol in run.scores):
                if key in taken:
                    raise ValueError(f"{' under '.join(key)} is there twice")
                taken.add(key)
        return self

    def _require_records(self, run: RowRun) -> None:
        if others := sorted(run.method.keys() - _OF_RUN):
            raise ValueError(f"{run.label}: method.{others[0]} is the same in all runs of a row")
        for name in ("method", "environment"):
            try:
                _with(getattr(self, name), getattr(run, name))
            except ValidationError as error:
                first = error.errors()[0]
                field = ".".join(map(str, (name, *first["loc"])))
                raise ValueError(f"{run.label}: {field}: {first['msg']}") from error

    def method_of(self, run: RowRun) -> record.MethodRecord:
        """Return the method of a run: the row's, but for what differs."""
        return _with(self.method, run.method)

    @property
    def manifest(self) -> Manifest:
        """The data set's manifest, released or drawn from a seed.

        Raises
        ------
        UnknownNameError
            If there is none of that name.
        """
        return _manifest_of(self.dataset)

    @property
    def commits(self) -> list[JsonValue]:
        """The commit of each run."""
        return [run.environment.get("git", self.environment.git) for run in self.runs]

    @functools.cached_property
    def results(self) -> tuple[record.Result, ...]:
        """The runs, each as a result of its own; errors of pairs are not kept."""
        return tuple(map(self._result, self.runs))

    def clean_results(self) -> Iterator[record.Result]:
        """Yield the results on clean images."""
        return (self._result(run) for run in self.runs if run.label == CLEAN)

    def results_on(self, fingerprint: str) -> Iterator[record.Result]:
        """Yield the results on these data only, since most rows are on many tracks."""
        return (self._result(run) for run in self.runs if run.fingerprint == fingerprint)

    def _result(self, run: RowRun) -> record.Result:
        manifest = self.manifest
        pairs, names, places = _pairs_of(self.dataset, self.split)
        records = run.records(pairs, names, places)
        done = sum(status == "ok" for status in run.status)
        on = "" if run.label == CLEAN else f"{AT}{run.label}"
        dataset = record.DatasetRecord.of(
            manifest,
            name=self.dataset + on,
            short=manifest.short + on,
            manifest_sha256=self.manifest_sha256,
            fingerprint=run.fingerprint,
            split=self.split,
            expected=len(pairs),
            evaluated=done,
            recipe=run.recipe,
            degradation=run.label,
            options=run.options,
        )
        whole = done == len(records)
        return record.Result.model_construct(
            schema_version=1,
            dataset=dataset,
            protocols=[RELEASED[label].as_dict() for label in run.scores],
            method=self.method_of(run),
            environment=_with(self.environment, run.environment),
            other_environments=run.other_environments,
            seed=self.seed,
            pairs=records,
            averages=record.average(records, list(run.scores)) if whole else None,
            warnings=run.warnings,
        )

    @property
    def given_blur(self) -> bool:
        """Whether the method was given a blur on a track."""
        return any(wording.knew_blur(self.method_of(run), run.label) for run in self.runs)

    def is_of(self, card: Card) -> bool:
        """Return whether a card is of the row's method."""
        method = self.method
        same = card.is_of(method.name, method.entry, method.parameters)
        return same and card.given_blur == self.given_blur

    def place(self, folder: Path, name: str) -> Path:
        """Return where the row of the card `name` is in a leaderboard's folder."""
        return folder / RESULTS / f"{self.dataset}-{self.split}" / f"{name}.json"


def _with(shared: _R, own: dict[str, Any]) -> _R:
    return type(shared).model_validate(shared.model_dump() | own) if own else shared


@functools.lru_cache(maxsize=64)
def _manifest_of(dataset: str) -> Manifest:
    known = [heading.stem for heading in released_headings()]
    if dataset not in known and seeded(dataset) is None:
        raise unknown_name("data set", dataset, known)
    return find_manifest(dataset)


def row_of(results: Sequence[record.Result], suites: Sequence[str]) -> Row:
    """Return runs of one method on one split as a row.

    Parameters
    ----------
    results : sequence of Result
        On clean images, on tracks, or both; of one label and protocol at most one.
    suites : sequence of str
        The rankings that the row stands in.
    """
    order = sorted(results, key=lambda result: _LABELS.index(result.dataset.degradation))
    first = order[0]
    return Row(
        schema_version=1,
        dataset=first.dataset.name.partition(AT)[0],
        manifest_sha256=first.dataset.manifest_sha256,
        split=first.dataset.split,
        suites=list(suites),
        method=first.method,
        environment=first.environment,
        seed=first.seed,
        pairs=[pair.id for pair in first.pairs],
        runs=[_run_of(result, first) for result in order],
    )


def _run_of(result: record.Result, first: record.Result) -> RowRun:
    dataset, pairs = result.dataset, result.pairs
    numbers = dict.fromkeys(name for pair in pairs for name in pair.numbers)
    scores = {}
    for label in result.protocol_names:
        metrics, found = metrics_of(label), [pair.scores.get(label, {}) for pair in pairs]
        columns = {name: [each.get(name) for each in found] for name in metrics}
        scored = {name for each in found for name in each}
        # A younger metric that the run was not scored by is left out.
        younger = {name for name, metric in metrics.items() if metric.younger}
        scores[label] = {k: v for k, v in columns.items() if k in scored or k not in younger}
    return RowRun(
        label=dataset.degradation,
        fingerprint=dataset.fingerprint,
        recipe=dataset.recipe,
        options=dataset.options,
        method=_other(result.method, first.method),
        environment=_other(result.environment, first.environment),
        other_environments=result.other_environments,
        machine=[pair.machine for pair in pairs] if result.other_environments else [],
        status=[pair.status for pair in pairs],
        timed_alone=all(pair.timed_alone for pair in pairs),
        seconds=[pair.seconds for pair in pairs],
        prediction_sha256=[pair.prediction_sha256 for pair in pairs],
        answered=[pair.answered for pair in pairs] if any(p.answered < 1 for p in pairs) else [],
        scores=scores,
        numbers={name: [pair.numbers.get(name) for pair in pairs] for name in numbers},
        warnings=result.warnings,
    )


def _other(own: Record, shared: Record) -> dict[str, Any]:
    """Return the fields of a record that differ from another's."""
    there = shared.model_dump()
    return {name: value for name, value in own.model_dump().items() if value != there[name]}


def row_text(row: Row) -> str:
    """Return a row's file: JSON with a line for each column, so that changes can be read."""
    return _text(json.loads(row.model_dump_json(exclude_defaults=True)), "") + "\n"


def _text(value: Any, indent: str) -> str:
    parts: list[str] = []
    if isinstance(value, dict) and any(isinstance(each, dict | list) for each in value.values()):
        parts = [f"{json.dumps(k)}: {_text(each, indent + ' ')}" for k, each in value.items()]
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        parts = [_text(each, indent + " ") for each in value]
    if not parts:
        return json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    begin, end = "{}" if isinstance(value, dict) else "[]"
    return f"{begin}\n{indent} " + f",\n{indent} ".join(parts) + f"\n{indent}{end}"


def read_row(path: Path) -> Row:
    """Read a row's file, wherever it is; its fields are checked, and its pairs.

    Raises
    ------
    ResultError
        If it cannot be read or is not such a file, or its data set or pairs are not released ones.
    """
    content = read_as(ResultError, path, "the row", fix="name a file of leaderboard/results")
    try:
        row = Row.model_validate_json(content, strict=True)
    except ValidationError as error:
        found = problems_of(error, "wrong value in a row of the leaderboard", file=path, fix=_FIX)
        raise ResultError.of(found) from error
    require_pairs(row, str(path))
    return row


@functools.lru_cache(maxsize=64)
def _pairs_of(dataset: str, split: str) -> tuple[tuple[Pair, ...], list[str], list[dict[str, int]]]:
    """Return a split's pairs, their names and places; many rows share them."""
    pairs = _manifest_of(dataset).pairs(split)
    return pairs, [pair.id for pair in pairs], [pair.at for pair in pairs]


def require_pairs(row: Row, where: str) -> None:
    """Refuse a row that is not on all pairs of a released data set's split.

    Raises
    ------
    ResultError
        If there is no such set or split, or the pairs differ.
    """
    try:
        pairs = _pairs_of(row.dataset, row.split)[1]
    except DfdbenchError as error:
        raise ResultError(str(error.problems[0]).partition("\n")[0], where=where) from error
    if row.pairs != pairs:
        odd = sorted({*pairs} ^ {*row.pairs}) or pairs
        what = f"the pairs are not those of {row.dataset}, split {row.split}: {listed(odd, most=3)}"
        raise ResultError(what, where=where, fix=_FIX)


_FIX = "write it with `dfdbench run ... --submit`"


def row_problems(row: Row, folder: Path, where: str) -> Iterator[Problem]:
    """Yield a problem for each way in which a row is not of released data and of its own method."""
    if row.manifest_sha256 != row.manifest.sha256:
        what = f"made from another manifest than {row.dataset}"
        yield Problem(what, where=f"{where}: manifest_sha256", fix=_FIX)
    known = known_fingerprints(folder)
    for run in row.runs:
        name = row.dataset if run.label == CLEAN else f"{row.dataset}{AT}{run.label}"
        if run.fingerprint not in known.get(name, [run.fingerprint]):
            place = f"{where}: {run.label}, fingerprint"
            fix = f"build {name} and run it again: `dfdbench build {name}`"
            yield Problem(f"run on other data than {name}", where=place, fix=fix)
        if VALID not in run.scores:
            what = f"no scores under {VALID}, by which rows are ranked"
            yield Problem(what, where=f"{where}: {run.label}, scores", fix=_FIX)
    name = row.method.name
    # Asking what packages offer takes a while, and no package takes a built-in name.
    entry = name if ":" in name else built_in_methods().get(name) or registered_methods().get(name)
    if not row.method.scored and entry and wording.without_folders(entry) != row.method.entry:
        what, expected = f"{name} is another method here", wording.without_folders(entry)
        about = {"where": f"{where}: method.entry", "got": row.method.entry}
        fix = "name the method by its entry: MODULE:NAME"
        yield Problem(what, expected=expected, fix=fix, **about)
    for fitted_on in dict.fromkeys(row.method_of(run).fitted_on for run in row.runs):
        if seen := scenes_seen(fitted_on or "", row.manifest, row.split):
            what = f"the method was fitted on scenes of the test, {', '.join(seen)}"
            yield Problem(what, where=where, fix="leave out --fitted: it is then fitted here")
    for trained_on in dict.fromkeys(row.method_of(run).trained_on for run in row.runs):
        yield from training_problems(
            trained_on, row.method.weights_sha256, row.dataset, row.split, where
        )


def known_fingerprints(folder: Path) -> dict[str, list[str]]:
    """Return the fingerprints that data sets must have, by name.

    Raises
    ------
    ResultError
        If the file that lists them cannot be read.
    """
    return read_list(folder / FINGERPRINTS, _Fingerprints, "fingerprints") or {}


def read_list(path: Path, kind: TypeAdapter[_T], what: str) -> _T | None:
    """Return what a list in the leaderboard's folder holds; None if there is none.

    Raises
    ------
    ResultError
        If it cannot be read.
    """
    try:
        return kind.validate_json(read_whole(path)) if path.exists() else None
    except (ValidationError, OSError) as error:
        what, fix = f"cannot read the list of {what}", f"git restore {path}"
        raise ResultError(what, where=str(path), fix=fix) from error


def training_problems(
    trained_on: str | None, weights_sha256: str | None, dataset: str, split: str, where: str
) -> list[Problem]:
    """Return a problem if weights were trained on scenes of the test.

    Parameters
    ----------
    trained_on : str or None
        What the method says about itself.
    weights_sha256 : str or None
        Of the weights; a method without any has learnt no scene by heart.
    dataset, split : str
        What is tested; the data set by the name and version of its manifest.
    where : str
        What the problem is about.
    """
    if not trained_on or not weights_sha256:
        return []
    seen = scenes_seen(trained_on, find_manifest(dataset), split)
    if not seen:
        return []
    what = f"the weights were trained on scenes of the test, {', '.join(seen)}"
    fix = "test on another split, or train without these scenes: dfdbench train --fold"
    return [Problem(what, where=where, fix=fix)]
