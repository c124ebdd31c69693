"""Numbers that the pages quote from the leaderboard are those of its rows."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from dfdbench.leaderboard.row_file import read_row
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import find_protocol
from dfdbench.results.record import Result
from dfdbench.results.wording import score_text

ROOT = Path(__file__).parents[1]
METRICS = {"NRMSE ↓": "nrmse", "NMAE ↓": "nmae", "SSIM ↑": "ssim"}
#: Rows of methods that the tables show beside those of the board.
NOT_ON_THE_BOARD = {
    "graph-cuts published_offset=true recipe=text",
    "graph-cuts published_offset=true",
    "s-transform recipe=null",
    "constant training_mean=38",
}


@dataclass(frozen=True)
class Quoted:
    """A table of a page: how its head begins, and the board that it quotes."""

    page: str
    head: str
    board: str
    protocol: str
    method: str = ""

    def __str__(self) -> str:
        return f"{self.page}: {self.head}"


QUOTED = [
    Quoted("leaderboard/note.md", "| | NRMSE", "middlebury-default-1-test", "thesis"),
    Quoted("docs/graph_cuts.md", "| protocol `thesis`", "middlebury-default-1-test", "thesis"),
    Quoted("docs/graph_cuts.md", "| | `thesis-networks`", "middlebury-default-1-test", ""),
    Quoted("docs/graph_cuts.md", "| method | scenes", "middlebury-default-1-all", "thesis"),
    Quoted("docs/classical.md", "| method | NRMSE", "demo-1-test", "valid"),
    Quoted("docs/metres.md", "| `dfdbench run --dataset dfd-indoor", "dfd-indoor-1-test", "valid"),
    Quoted(
        "docs/training.md",
        "| DfD-Net / 8, the six",
        "middlebury-default-1-test",
        "thesis",
        "dfd-net",
    ),
    Quoted("docs/training.md", "| the 29 test scenes", "dfd-indoor-1-test", "valid", "dfd-net"),
]


@dataclass
class Column:
    """What a column of a table holds: a metric under a protocol, or its range over scenes."""

    metric: str
    protocol: str
    is_range: bool = False


@functools.cache
def results(board: str, protocol: str) -> dict[str, Result]:
    """Return the results of a data set and split by method and parameters."""
    rows = [read_row(path) for path in (ROOT / "leaderboard/results" / board).glob("*.json")]
    return {
        key(result.method.name, result.method.parameters): result
        for row in rows
        if "clean" in row.suites
        for result in row.results
        if result.dataset.degradation == "clean" and protocol in result.protocol_names
    }


def key(name: str, parameters: object) -> str:
    assert isinstance(parameters, dict)
    return " ".join([name, *sorted(f"{word}={value}" for word, value in parameters.items())])


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def table(quoted: Quoted) -> tuple[list[str], list[list[str]]]:
    lines = (ROOT / quoted.page).read_text("utf-8").splitlines()
    (start,) = [at for at, line in enumerate(lines) if line.startswith(quoted.head)]
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append(cells(line))
    return cells(lines[start]), rows


def columns(quoted: Quoted, head: list[str]) -> dict[int, Column]:
    """Return the columns that hold scores; a head that names a protocol goes on to the right."""
    found: dict[int, Column] = {}
    protocol, metric = quoted.protocol, ""
    for at, text in enumerate(head[1:], 1):
        if named := re.match(r"`([\w-]+)`", text):
            protocol = find_protocol(named[1]).label
        for heading, name in METRICS.items():
            if text.endswith(heading):
                metric = name
                found[at] = Column(metric, protocol)
        if text.startswith("range of"):
            found[at] = Column(metric, protocol, is_range=True)
    return found


def methods(quoted: Quoted, rows: list[list[str]]) -> Iterator[tuple[str, list[str]]]:
    """Yield the rows that name a method in code, with its name and its parameters in order."""
    name, parameters = quoted.method, dict[str, str]()
    for row in rows:
        words = re.sub(r"--param", " ", " ".join(re.findall(r"`(.+?)`", row[0]))).split()
        if not words:
            continue
        if not row[0].startswith("the same"):
            name, parameters = quoted.method, {}
        elif len([word for word in words if "=" not in word]):
            raise AssertionError(f"{row[0]}: the same, and yet another method")
        given = dict(parameters)
        for word in words:
            if "=" in word:
                before, _, value = word.partition("=")
                given[before] = value
            else:
                name = word
        if not row[0].startswith("the same"):
            parameters = given
        yield key(name, given), row


def expected(result: Result, column: Column, cell: str, scenes: list[str]) -> str:
    def mean(of: list[str]) -> float | None:
        pairs = [pair for pair in result.pairs if pair.scene in of]
        return mean_of(pair.score(column.protocol, column.metric) for pair in pairs)

    by_scene = [score for scene in scenes if (score := mean([scene])) is not None]
    over_scenes = f"{score_text(min(by_scene))} to {score_text(max(by_scene))}"
    if column.is_range:
        return over_scenes
    alone = score_text(mean(scenes))
    return f"{alone} ({over_scenes})" if "(" in cell else alone


@pytest.mark.parametrize("quoted", QUOTED, ids=str)
def test_a_table_that_quotes_the_board_has_its_numbers(quoted: Quoted) -> None:
    head, rows = table(quoted)
    found = columns(quoted, head)
    assert found
    wrong, compared = [], 0
    for name, row in methods(quoted, rows):
        if name in NOT_ON_THE_BOARD:
            continue
        for at, column in found.items():
            result = results(quoted.board, column.protocol)[name]
            scenes = sorted({pair.scene for pair in result.pairs})
            if "scenes" in head and not row[1].isdigit():
                scenes = row[1].split(", ")
            right = expected(result, column, row[at], scenes)
            compared += 1
            if row[at] != right:
                wrong.append(f"{name}, {column.protocol}: {row[at]}, on the board {right}")
    assert not wrong
    assert compared >= 3
