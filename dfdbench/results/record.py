"""A result: what a run found, pair by pair, and its file."""

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, JsonValue, TypeAdapter, ValidationError, model_validator

from dfdbench.datasets.manifest import Manifest, Name, Pair, simulated_label
from dfdbench.errors import ResultError
from dfdbench.metrics.metric import IN_METRES, METRICS, SURENESS, mean_of
from dfdbench.metrics.protocol import SURE, Unit, label_of, metrics_of
from dfdbench.metrics.scores import LARGEST_NUMBER
from dfdbench.system.files import read_text_as, write_whole
from dfdbench.system.strict import LINE, Record, problems_of
from dfdbench.system.text import parse_json

#: The name of a result's file in the run's folder.
RESULT = "result.json"

Finite = Annotated[float, Field(allow_inf_nan=False)]
#: The bounds are far above any run's times, but keep sums finite.
Seconds = Annotated[float, Field(allow_inf_nan=False, ge=0, le=1e9)]
Share = Annotated[float, Field(allow_inf_nan=False, ge=0, le=1)]
Number = Annotated[float, Field(allow_inf_nan=False, ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Coordinate = Annotated[int, Field(ge=-(2**31), lt=2**31)]
Count = Annotated[int, Field(ge=0, lt=2**31)]
#: What `numpy.random.seed` takes.
Seed = Annotated[int, Field(ge=0, lt=2**32)]
#: Text on one line, without control characters.
Line = Annotated[str, Field(pattern=LINE, max_length=1000)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
#: How the result of depth maps made elsewhere is marked wherever its method is named.
SCORED = "scored, not run"


def by_metric(scores: dict[str, float | None]) -> dict[str, float | None]:
    """Return a pair's scores under a protocol, after checking metrics and bounds.

    Raises
    ------
    ValueError
        If a metric is missing or unknown, or a score is out of bounds.
    """
    others = (kind for kind in (IN_METRES, SURENESS) if scores.keys() & kind.keys())
    known = next(others, METRICS)
    # For other kinds, a protocol's definition says which metrics there are.
    needed = [name for name in METRICS if known is METRICS and not METRICS[name].younger]
    if scores.keys() - known.keys() or {*needed} - scores.keys():
        raise ValueError(f"metrics should be {', '.join(known)}, not {', '.join(scores)}")
    for name, value in scores.items():
        low, high = known[name].lowest, known[name].highest
        if value is not None and not low <= value <= high:
            raise ValueError(f"{name} should be from {low:g} to {high:g}, not {value:g}")
    return scores


#: The scores of one pair under one protocol, by metric, all of one kind; None
#: where a metric is undefined.
PairScores = Annotated[dict[str, Finite | None], AfterValidator(by_metric)]


def pair_scores(scores: Mapping[str, float]) -> dict[str, float | None]:
    """Return scores as results keep them: checked, and None where a metric is undefined.

    Examples
    --------
    >>> pair_scores({"nrmse": 0.1, "nmae": 0.05, "ssim": math.nan})
    {'nrmse': 0.1, 'nmae': 0.05, 'ssim': None}
    """
    return by_metric({name: None if math.isnan(v) else v for name, v in scores.items()})


class PairResult(Record):
    """What became of one pair.

    `status`: ``ok``; ``failed``, the method gave no usable depth (`error` says why);
    ``missing``, the store does not hold the pair; ``not-run``, the run was limited. Only where
    `timed_alone` can `seconds` be compared, and only with pairs of the same `machine`, its place
    among the result's `environments`. `numbers` are what the method said of its answer, an energy
    for example. `answered` is the share of pixels that have an answer: where it is below 1, scores
    are null but under the protocol that asks how sure a method is. `regions` has the NRMSE of each
    of `dfdbench.metrics.regions.REGIONS`.
    """

    id: str
    scene: Name
    coordinates: dict[Name, Coordinate]
    status: Literal["ok", "failed", "missing", "not-run"]
    seconds: Seconds | None = None
    timed_alone: bool = True
    machine: Count = 0
    prediction_sha256: Sha256 | None = None
    answered: Share = 1.0
    regions: dict[Name, Finite | None] = Field(default_factory=dict)
    scores: dict[Name, PairScores] = Field(default_factory=dict)
    numbers: dict[str, Number] = Field(default_factory=dict)
    error: str | None = None
    warnings: list[str] = Field(default_factory=list)

    @property
    def pair(self) -> Pair:
        """The record's pair, with its axes in the order recorded."""
        return self.pair_on(self.coordinates)

    def pair_on(self, axes: Iterable[str]) -> Pair:
        """Return the record's pair, with its axes in this order."""
        return Pair(self.scene, tuple((axis, self.coordinates[axis]) for axis in axes))

    def score(self, protocol: str, metric: str) -> float | None:
        """Return a score; None if it is undefined or was not scored: see `Metric.younger`."""
        return self.scores.get(protocol, {}).get(metric)

    def lacks_answers(self, protocol: str, metric: str | None = None) -> bool:
        """Whether pixels lack an answer that this protocol needs, or a metric of `SURE`."""
        if protocol != SURE:
            return self.answered < 1
        return bool(metric and self.answered < 1 and self.score(protocol, metric) is None)


def _with_name(record: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(record.get("name"), str):
        raise ValueError("it has no name")
    return record


def _with_safe_name(record: dict[str, Any]) -> dict[str, Any]:
    TypeAdapter(Name).validate_python(_with_name(record)["name"])
    known = [*IN_METRES, *SURENESS]
    if not set(TypeAdapter(list[str]).validate_python(record.get("metrics", []))) <= {*known}:
        raise ValueError(f"its metrics are not of {', '.join(known)}")
    return record


def _as_utf8(parameters: dict[str, Any]) -> dict[str, Any]:
    # Parameters appear in file names and tables.
    json.dumps(parameters, ensure_ascii=False, allow_nan=False).encode()
    return parameters


#: A method's parameters, as far as a file can keep them.
Parameters = Annotated[dict[str, JsonValue], AfterValidator(_as_utf8)]

#: A protocol's definition, whose name may become part of a path.
ProtocolRecord = Annotated[dict[str, Any], AfterValidator(_with_safe_name)]
RecipeRecord = Annotated[dict[str, Any], AfterValidator(_with_name)]
#: A data set's name, with its track if it is on one; as safe in a path as a `Name`.
DataName = Annotated[
    str,
    Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*(@[a-z]+(-[a-z]+)*-[1-9][0-9]?)?$", max_length=120),
]


class DatasetRecord(Record):
    """Which data the run used; names are such as may become part of a path.

    `simulated` is set where a simulator made what stands for a camera's captures. `groups` has the
    family or room of scenes that share one.
    """

    name: DataName
    short: DataName
    manifest_sha256: Sha256
    fingerprint: Sha256
    split: Name
    expected: Count
    evaluated: Count
    recipe: RecipeRecord
    degradation: str
    options: dict[str, Any]
    axes: Annotated[list[Name], Field(min_length=1)]
    blocks: Name
    rows: Name | None
    simulated: bool = False
    groups: dict[Name, Name] = Field(default_factory=dict)

    @classmethod
    def of(cls, manifest: Manifest, **facts: Any) -> Self:
        """Return the record of a data set; `facts` are those that its manifest does not have."""
        return cls(
            axes=list(manifest.axes),
            blocks=manifest.table.blocks,
            rows=manifest.table.rows,
            simulated=manifest.simulated,
            groups=manifest.groups,
            **facts,
        )

    @property
    def label(self) -> str:
        """The name in tables and figures; simulated data sets are marked as such."""
        return simulated_label(self.name, self.simulated)

    @property
    def heading(self) -> str:
        """Its label and the split that was run, for titles."""
        return f"{self.label}, split {self.split}"

    def group_of(self, scene: str) -> str:
        """Return a scene's group; a scene without one is its own group."""
        return self.groups.get(scene, scene)


class MethodRecord(Record):
    """Which method was run, and how.

    `files_sha256` is of what parameters name: files, and folders by their files' names and
    contents. `fitted_on` says which pairs the method's fit saw before the run, in the words of
    `trained_on`; `fit_seconds` how long that took, which no pair's time holds. `scored` is set
    where nothing was run: depth maps made elsewhere were handed in, in that unit. `chosen` is what
    the fit of one of our methods chose on training pairs, where that is not as usual.
    """

    name: Line
    entry: Line
    source_sha256: Sha256 | None
    parameters: Parameters
    uses: list[str]
    trained_on: str | None
    paper: str | None
    weights_sha256: Sha256 | None = None
    files_sha256: dict[str, Sha256] = Field(default_factory=dict)
    fitted_on: str | None = None
    fit_seconds: Seconds | None = None
    chosen: dict[Name, Finite] = Field(default_factory=dict)
    scored: Unit | None = None

    @property
    def title(self) -> str:
        """The name in tables and figures; depth maps made elsewhere are marked as such."""
        return f"{self.name} ({SCORED})" if self.scored else self.name


class Environment(Record):
    """Where it was run."""

    python: str
    platform: str
    cpu: str
    cpu_count: Annotated[int, Field(ge=1, lt=2**20)]
    threads: dict[str, Count]
    gpu: str | None
    git: str | None
    versions: dict[str, str]


class Result(Record):
    """A run in full. `averages` is null unless every expected pair was evaluated.

    `environment` is where the run began, `other_environments` where it went on.
    """

    schema_version: Literal[1]
    dataset: DatasetRecord
    protocols: list[ProtocolRecord]
    method: MethodRecord
    environment: Environment
    other_environments: list[Environment] = Field(default_factory=list)
    seed: Seed
    pairs: list[PairResult]
    averages: dict[Name, dict[str, Finite | None]] | None
    warnings: list[str] = Field(default_factory=list)

    @model_validator(mode="after")
    def _check(self) -> Self:
        data, pairs, protocols = self.dataset, self.pairs, self.protocol_names
        # Tables and figures look up pairs by axis, and depth maps by scene and coordinates.
        if not {data.blocks, data.rows or data.blocks} <= set(data.axes):
            raise ValueError(f"blocks and rows are not among the axes {', '.join(data.axes)}")
        if len(set(data.axes)) < len(data.axes) or len(set(protocols)) < len(protocols):
            raise ValueError("an axis or a protocol is listed twice")
        for pair in pairs:
            if pair.coordinates.keys() != set(data.axes) or pair.id != pair.pair_on(data.axes).id:
                raise ValueError(f"{pair.id} is not where its name says")
            if pair.status == "ok" and pair.scores.keys() != set(protocols):
                raise ValueError(f"{pair.id} is not scored under {', '.join(protocols)}")
            if pair.machine >= len(self.environments):
                raise ValueError(f"{pair.id} was run on a machine that is not listed")
        counts = len(pairs), len(self.evaluated)
        if counts != (data.expected, data.evaluated) or len({p.id for p in pairs}) < len(pairs):
            raise ValueError("the pairs do not add up")
        return self

    @property
    def protocol_names(self) -> tuple[str, ...]:
        """The labels of the protocols that were scored, which are the keys of `scores`."""
        return tuple(label_of(protocol) for protocol in self.protocols)

    @property
    def environments(self) -> tuple[Environment, ...]:
        """Where pairs were run; each pair's `machine` is an index into it."""
        return (self.environment, *self.other_environments)

    @property
    def evaluated(self) -> list[PairResult]:
        """The pairs that have scores."""
        return [pair for pair in self.pairs if pair.status == "ok"]

    @property
    def complete(self) -> bool:
        """True if every expected pair was evaluated; only then is there an average."""
        return len(self.evaluated) == len(self.pairs)

    def mean(self, protocol: str, metric: str) -> float | None:
        """Return a metric's average, or None if there is none."""
        return (self.averages or {}).get(protocol, {}).get(metric)


def average(pairs: list[PairResult], protocols: list[str]) -> dict[str, dict[str, float | None]]:
    """Return each metric's mean over the pairs for which it is defined, by protocol.

    There is none if a pair lacks answers, as leaving pairs out would improve the mean.
    """
    means = {}
    for protocol in protocols:
        means[protocol] = {
            metric: None
            if any(pair.lacks_answers(protocol, metric) for pair in pairs)
            else mean_of(pair.score(protocol, metric) for pair in pairs)
            for metric in metrics_of(protocol)
        }
    return means


def save_result(result: Result, path: Path) -> None:
    """Write a result as JSON, completely or not at all."""
    write_whole(path, result.model_dump_json(indent=1) + "\n")


def load_result(path: Path | str) -> Result:
    """Read a run's result, check it, and compute its averages anew.

    Parameters
    ----------
    path : Path or str
        The result file, or the folder of the run.

    Raises
    ------
    ResultError
        If it cannot be read, a field is wrong, or it contradicts itself.
    """
    path = Path(path)
    path = path / RESULT if path.is_dir() else path
    fix = "name what `dfdbench run` wrote: results/DATASET-SPLIT/METHOD"
    text = read_text_as(ResultError, path, "the result", fix)
    try:
        result = Result.model_validate(parse_json(text), strict=True)
    except ValidationError as error:
        raise ResultError.of(problems_of(error, "wrong value in the result", file=path)) from error
    except ValueError as error:
        what = f"the result is damaged: {error if text.strip() else 'an empty file'}"
        fix = "the same `dfdbench run` writes it anew, from the pairs that it kept"
        raise ResultError(what, where=str(path), fix=fix) from error
    means = average(result.pairs, list(result.protocol_names)) if result.complete else None
    return result.model_copy(update={"averages": means})


def first_protocol(short: str) -> str:
    """Return the protocol by which a data set is shown and ranked first.

    It is ``valid``, except for Middlebury without a track, which the thesis's printed tables use.
    Their protocol counts pixels of unknown depth as depth 0.

    Parameters
    ----------
    short : str
        The data set's short name, with its track.

    Examples
    --------
    >>> first_protocol("demo"), first_protocol("middlebury"), first_protocol("middlebury@camera-2")
    ('valid', 'thesis', 'valid')
    """
    return "thesis" if short.startswith("middlebury") and "@" not in short else "valid"


def shown_protocol(result: Result) -> str:
    """Return the protocol under which to show a result first, among those it was scored under.

    A file of the leaderboard has only one.
    """
    first = first_protocol(result.dataset.short)
    names = result.protocol_names
    return first if first in names else next(iter(names), first)
