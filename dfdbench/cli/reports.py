"""The verbs that read results: report, compare."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from dfdbench.cli.answer import writing
from dfdbench.cli.screen import print_table, progress, say
from dfdbench.errors import InputError
from dfdbench.figures.comparison import change_figure
from dfdbench.figures.style import write_figure
from dfdbench.leaderboard.folder import file_stems
from dfdbench.metrics.of_protocol import ranked_by
from dfdbench.metrics.protocol import find_protocol
from dfdbench.report.html import write_html
from dfdbench.report.markdown import write_markdown
from dfdbench.results.difference_tables import change_tables, changes_to_show
from dfdbench.results.first_table import first_protocol
from dfdbench.results.record import Result
from dfdbench.results.record_file import RESULT
from dfdbench.results.saved_run import SavedRun, open_run
from dfdbench.results.wording import method_label
from dfdbench.tables.render import render
from dfdbench.tables.table import Format

_PANELS = 4
_PICTURES = (".png", ".pdf", ".svg")
Dataset = Annotated[
    str | None, typer.Option(help="A store's path; default: where the runs found it.")
]
ProtocolName = Annotated[
    str | None, typer.Option(help="Under which protocol; default: thesis, of captures valid.")
]


class PageFormat(StrEnum):
    """The form of a report."""

    html = "html"
    markdown = "markdown"


def report(
    results: Annotated[list[Path], typer.Argument(help="Result files or runs' folders.")],
    out: Annotated[Path, typer.Option(help="The folder that it goes into.")],
    protocol: ProtocolName = None,
    format: Annotated[
        PageFormat, typer.Option(help="One HTML page, or Markdown with PNG files.")
    ] = PageFormat.html,
    dataset: Dataset = None,
) -> None:
    """Write a page about runs: tables, plots, and their pairs, worst first."""
    asked = find_protocol(protocol).label if protocol else None
    runs = [open_run(path, dataset) for path in _each_once(results)]
    shown = asked or _first_of(runs[0].result)
    with writing(out):
        # Before the drawing, which takes a while.
        out.mkdir(parents=True, exist_ok=True)
        if format is PageFormat.html:
            with progress("drawing pairs") as step:
                path = write_html(runs, shown, out, step)
        else:
            path = write_markdown(runs, shown, out)
    for run in runs:
        if run.without:
            say(f"no pictures of {run.label}: {run.without}")
    print(path)


def compare(
    first: Annotated[Path, typer.Argument(metavar="A", help="A result file or a run's folder.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another on the same data.")],
    protocol: ProtocolName = None,
    most: Annotated[int, typer.Option(min=1, help="How many changed pairs are listed.")] = 10,
    format: Annotated[Format, typer.Option(help="How the tables are printed.")] = Format.table,
    out: Annotated[
        Path | None,
        typer.Option(help="Panels of changed pairs: a PNG, PDF or SVG file, or a folder."),
    ] = None,
    dataset: Dataset = None,
) -> None:
    """Compare two runs pair by pair: differences, wins, losses, what changed most."""
    asked = find_protocol(protocol).label if protocol else None
    runs = open_run(first, dataset), open_run(second, dataset)
    shown = asked or _first_of(runs[0].result)
    if runs[0].path.resolve() == runs[1].path.resolve():
        raise InputError("A and B are the same run", where=str(runs[0].path), expected="two runs")
    results = runs[0].result, runs[1].result
    picture = _picture(out, *results)
    tables = change_tables(*results, shown, most)
    if format is Format.table:
        for table in tables:
            print_table(table)
    else:
        # A sheet holds one kind of row.
        print(render(tables[:1] if format is Format.csv else tables, format), end="")
    _draw_changes(runs, shown, min(most, _PANELS), picture)


def _first_of(result: Result) -> str:
    told = result.dataset
    return first_protocol(told.short, str(told.recipe["name"]), told.degradation)


def _draw_changes(
    runs: tuple[SavedRun, SavedRun], protocol: str, count: int, picture: Path
) -> None:
    found = changes_to_show(runs[0].result, runs[1].result, protocol, count)
    figure = change_figure(*runs, found, ranked_by(protocol)[0])
    if figure is None:
        reasons = dict.fromkeys(run.without for run in runs if run.without)
        nothing = "no depth maps of these pairs" if found else "no pair changed"
        say(f"no panels: {'; '.join(reasons) or nothing}")
        return
    before = " (in place of an earlier one)" if picture.exists() else ""
    with writing(picture):
        picture.parent.mkdir(parents=True, exist_ok=True)
        write_figure(figure, picture)
    say(f"panels       {picture}{before}")


def _picture(out: Path | None, first: Result, second: Result) -> Path:
    if out is None:
        a, b = (
            file_stems(method_label(result.method), result.dataset.fingerprint)[0]
            for result in (first, second)
        )
        dataset = first.dataset
        return Path("results") / f"compare-{dataset.name}-{dataset.split}-{a}-vs-{b}.png"
    if out.is_dir() or not out.suffix:
        return out / "compare.png"
    if out.suffix.lower() not in _PICTURES:
        raise InputError(
            "not a picture's name",
            where="--out",
            expected=f"a folder, or {', '.join(_PICTURES)}",
            got=out.name,
        )
    return out


def _each_once(paths: Sequence[Path]) -> list[Path]:
    found: dict[Path, Path] = {}
    for path in paths:
        file = (path / RESULT if path.is_dir() else path).resolve()
        if file in found:
            say(f"given twice, shown once: {path}")
        else:
            found[file] = path
    return list(found.values())
