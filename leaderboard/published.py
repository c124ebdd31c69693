"""Numbers printed in a publication, carried over with their origin: read them, show them."""

from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator

from dfdbench.errors import Problem, ResultError, reason_of
from dfdbench.metrics.metric import METRICS, RANKED_BY, mean_of
from dfdbench.results.wording import NOTHING, score_text, seconds_text
from dfdbench.system.files import read_whole
from dfdbench.system.strict import Record, problems_of
from dfdbench.system.text import parse_json
from dfdbench.tables.table import Table

PUBLISHED = "published"

_EXPOSURES = (0, 1, 2)
Text = Annotated[str, Field(min_length=1)]
Printed = Annotated[Decimal, Field(allow_inf_nan=False)]


def _known(name: str) -> str:
    if name not in METRICS:
        raise ValueError(f"should be one of {', '.join(METRICS)}")
    return name


MetricName = Annotated[str, AfterValidator(_known)]


class PublishedRow(Record):
    """One printed row.

    `at` says what it is of, in the table's own words: a lighting, a fold, a pair, a statistic;
    ``all`` stands for all values together. `std` are printed standard deviations, `values` what
    is no score, by the table's own columns: its `quantity` says what they are. Numbers are kept
    with the digits that were printed.
    """

    method: Text
    at: dict[str, str]
    scores: dict[MetricName, Printed] = Field(default_factory=dict)
    std: dict[MetricName, Printed] = Field(default_factory=dict)
    values: dict[str, Printed] = Field(default_factory=dict)
    seconds: Printed | None = None
    device: str | None = None


class PublishedTable(Record):
    """A printed table, or numbers of a figure that the text gives.

    `table` is its number, `kind` whether it is one; `quantity` what the rows' `values` are.
    `page` is null where the copy that it was carried over from has no page numbers; table and
    section find it there. `compare` names the set of rows that the publication itself sets
    side by side; `training` what the methods were trained on; `protocol` how they were scored,
    as far as known; `note` is ours, not the publication's.
    """

    schema_version: Literal[1]
    citation: Text
    doi: Text
    kind: Literal["table", "figure"] = "table"
    table: Annotated[str, Field(pattern=r"^(\d+|[A-Z])\.\d+$")]
    section: Text
    page: Annotated[int, Field(ge=1)] | None
    title: Text
    dataset: Text
    scope: Text
    pairs: Annotated[int, Field(ge=1)] | None
    compare: str | None
    training: Text
    quantity: Text | None = None
    protocol: Text
    note: Text
    rows: Annotated[list[PublishedRow], Field(min_length=1)]

    @model_validator(mode="after")
    def _values_are_of_something(self) -> Self:
        if any(row.values for row in self.rows) != (self.quantity is not None):
            raise ValueError("quantity says what the rows' values are: both or neither")
        return self

    @property
    def order(self) -> tuple[bool, int, int, str]:
        """What to sort by: chapters before appendices, their numbers, figures before tables."""
        chapter, number = self.table.split(".")
        appendix = not chapter.isdigit()
        return appendix, ord(chapter) if appendix else int(chapter), int(number), self.kind

    @property
    def name(self) -> str:
        """What it is called: ``Table 5.6``, ``Figure 6.5``."""
        return f"{self.kind.capitalize()} {self.table}"


def load_published(folder: Path) -> list[PublishedTable]:
    """Read the published tables of a leaderboard, in the order of their numbers.

    Raises
    ------
    ResultError
        With everything that is wrong in any of the files.
    """
    tables: list[PublishedTable] = []
    problems: list[Problem] = []
    for path in sorted((folder / PUBLISHED).glob("*.json")):
        try:
            tables.append(PublishedTable.model_validate(parse_json(read_whole(path))))
        except ValidationError as error:
            problems += problems_of(error, "wrong value in the published table", file=path)
        except (OSError, ValueError) as error:
            problems.append(Problem(f"cannot read it: {reason_of(error)}", where=str(path)))
    ResultError.raise_if(problems)
    return sorted(tables, key=lambda table: table.order)


def _in_all_light(rows: Sequence[PublishedRow], method: str) -> list[PublishedRow]:
    return [row for row in rows if row.method == method and row.at.get("illumination") == "all"]


def _overall(rows: Sequence[PublishedRow], method: str, metric: str) -> float | None:
    """Return the mean over the exposures' printed overall values; None where one is missing.

    The publication prints no value over all pairs; where each exposure has as many pairs as
    any other, as in the thesis's test split, this mean is that value up to rounding.
    """
    overall = _in_all_light(rows, method)
    values = [float(row.scores[metric]) for row in overall if metric in row.scores]
    return mean_of(values) if len(values) == len(overall) else None


def published_summary(tables: Sequence[PublishedTable], compare: str) -> Table:
    """Return the rows that a publication sets side by side, best first, without a rank."""
    chosen = [table for table in tables if table.compare == compare]
    first = chosen[0]
    found: dict[str, PublishedTable] = {}
    for table in chosen:
        for row in table.rows:
            found.setdefault(row.method, table)
    lines = []
    for method, table in found.items():
        means = {metric: _overall(table.rows, method, metric) for metric in METRICS}
        of_exposures = (row.scores.get(RANKED_BY) for row in _in_all_light(table.rows, method))
        scores = (*map(score_text, means.values()), *map(_printed, of_exposures))
        cells = (method, *scores, _published_seconds(tables, method), table.name, "published")
        lines.append((means[RANKED_BY] or 0.0, cells))
    columns = (
        "method",
        *(metric.heading for metric in METRICS.values()),
        *(f"{METRICS[RANKED_BY].title}, exposure {level}" for level in _EXPOSURES),
        *("seconds an image", "where", "status"),
    )
    rows = tuple(cells for _, cells in sorted(lines))
    notes = (
        "The overall means are ours, of the exposures' printed ones, 18 pairs each; seconds are "
        "the mean of the printed run times, for graph cuts over all scenes.",
    )
    title = f"{first.dataset}, {first.scope}: published, not rerun, not ranked"
    return Table(title, columns, rows, "l" + "r" * (len(METRICS) + len(_EXPOSURES)) + "lll", notes)


def published_table(table: PublishedTable) -> Table:
    """Return a published table as it is printed, with its origin."""
    rows, first = table.rows, table.rows[0]
    columns = [("method", "l", "method", "")] * any(row.method != first.method for row in rows)
    columns += [(at, "l", "at", at) for at in dict.fromkeys(at for row in rows for at in row.at)]
    for name in (name for name in METRICS if any(name in row.scores for row in rows)):
        columns.append((METRICS[name].heading, "r", "scores", name))
        columns += [("std", "r", "std", name)] * any(row.std for row in rows)
    values = dict.fromkeys(name for row in rows for name in row.values)
    columns += [(name, "r", "values", name) for name in values]
    if any(row.seconds is not None for row in rows):
        columns += [("seconds", "r", "seconds", ""), ("device", "l", "device", "")]
    headings, sides, fields, keys = zip(*columns, strict=True)
    shown = tuple(
        tuple(_cell(row, *place) for place in zip(fields, keys, strict=True)) for row in rows
    )
    where = f"page {table.page}" if table.page else f"section {table.section}"
    pairs = f", {table.pairs} pairs" if table.pairs else ""
    what = f"Numbers: {table.quantity}. " if table.quantity else ""
    trained = f"{what}Trained on: {table.training}. Protocol: {table.protocol}."
    notes = (trained, f"Our note: {table.note}")
    title = f"{table.name} ({where}): {table.title}; {table.dataset}, {table.scope}{pairs}"
    return Table(title, headings, shown, "".join(sides), notes)


def _cell(row: PublishedRow, field: str, key: str) -> str:
    found = getattr(row, field)
    value = found.get(key) if isinstance(found, dict) else found
    return _printed(value) if value or field not in ("at", "device") else ""


def _published_seconds(tables: Sequence[PublishedTable], method: str) -> str:
    by_device: dict[str, list[float]] = {}
    for table in tables:
        for row in table.rows:
            if row.method == method and row.seconds is not None:
                by_device.setdefault(row.device or "", []).append(float(row.seconds))
    parts = [f"{seconds_text(mean_of(v))} ({device})" for device, v in by_device.items()]
    return "; ".join(parts) or NOTHING


def _printed(value: Decimal | str | None) -> str:
    return NOTHING if value is None else str(value)
