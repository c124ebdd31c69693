"""Numbers printed in a publication: carried over with their origin, not rerun."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationError, model_validator

from dfdbench.errors import Problem, ResultError, reason_of
from dfdbench.leaderboard.folder import PUBLISHED, read_own
from dfdbench.metrics.metric import METRICS, mean_of
from dfdbench.system.json_text import parse_json
from dfdbench.system.record import Record, problems_of

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
    def _values_are_of_something(self) -> PublishedTable:
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
            tables.append(PublishedTable.model_validate(parse_json(read_own(path) or b"")))
        except ResultError as error:
            problems += error.problems
        except ValidationError as error:
            problems += problems_of(error, "wrong value in the published table", file=path)
        except (OSError, ValueError) as error:
            problems.append(
                Problem("cannot read the published table", where=str(path), got=reason_of(error))
            )
    if problems:
        raise ResultError.of(problems)
    return sorted(tables, key=lambda table: table.order)


def mean_over(rows: Sequence[PublishedRow], method: str, metric: str) -> float | None:
    """Return the mean over the exposures' printed overall values; None where one is missing.

    The publication prints no value over all pairs; where each exposure has as many pairs as
    any other, as in the thesis's test split, this mean is that value up to rounding.
    """
    overall = [row for row in rows if row.method == method and row.at.get("illumination") == "all"]
    values = [float(row.scores[metric]) for row in overall if metric in row.scores]
    return mean_of(values) if len(values) == len(overall) else None
