"""The verbs that read results: report, compare."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from dfdbench.change_tables import change_tables, most_changed
from dfdbench.cli.screen import print_table, progress, say
from dfdbench.comparison_figures import change_figure
from dfdbench.page.html import write_html
from dfdbench.page.markdown import write_markdown
from dfdbench.protocol import find_protocol
from dfdbench.runs import open_run
from dfdbench.tables import Format, render

_PANELS = 4
Dataset = Annotated[
    str | None, typer.Option(help="A store's path; default: the data set that a result names.")
]


class PageFormat(StrEnum):
    """The form of a report."""

    html = "html"
    markdown = "markdown"


def report(
    results: Annotated[list[Path], typer.Argument(help="Result files or runs' folders.")],
    out: Annotated[Path, typer.Option(help="The folder that it goes into.")],
    protocol: Annotated[str, typer.Option(help="Under which protocol.")] = "thesis",
    format: Annotated[
        PageFormat, typer.Option(help="One HTML page, or Markdown with PNG files.")
    ] = PageFormat.html,
    dataset: Dataset = None,
) -> None:
    """Write a page about runs: tables, plots, and their pairs, worst first."""
    shown = find_protocol(protocol).name
    runs = [open_run(path, dataset) for path in results]
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
    protocol: Annotated[str, typer.Option(help="Under which protocol.")] = "thesis",
    most: Annotated[int, typer.Option(min=1, help="How many changed pairs are listed.")] = 10,
    format: Annotated[Format, typer.Option(help="How the tables are printed.")] = Format.table,
    out: Annotated[
        Path | None, typer.Option(help="Where the panels of changed pairs go, a PNG file.")
    ] = None,
    dataset: Dataset = None,
) -> None:
    """Compare two runs pair by pair: differences, wins, losses, what changed most."""
    shown = find_protocol(protocol).name
    runs = open_run(first, dataset), open_run(second, dataset)
    results = runs[0].result, runs[1].result
    tables = change_tables(*results, shown, most)
    if format is Format.table:
        for table in tables:
            print_table(table)
    else:
        print(render(tables, format), end="")
    found = most_changed(*results, shown, _PANELS)
    figure = change_figure(*runs, found, "nrmse")
    if figure is None:
        reasons = dict.fromkeys(run.without for run in runs if run.without)
        say(f"no panels: {'; '.join(reasons) or 'no depth maps of these pairs'}")
        return
    path = out or Path("results") / "compare.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    say(f"panels       {path}")
