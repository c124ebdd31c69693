"""The verbs that read results: report, compare."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dfdbench.change_tables import change_tables, most_changed
from dfdbench.cli.screen import print_table, say
from dfdbench.comparison_figures import change_figure
from dfdbench.protocol import find_protocol
from dfdbench.runs import open_run
from dfdbench.tables import Format, render

_PANELS = 4
Dataset = Annotated[
    str | None, typer.Option(help="A store's path; default: the data set that a result names.")
]


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
