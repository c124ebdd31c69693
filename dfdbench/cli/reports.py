"""The verbs that read results: report, compare, leaderboard."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument, Context, Exit, Option

import dfdbench
from dfdbench.board import LEADERBOARD, SCORE_TOLERANCE
from dfdbench.cli import screen
from dfdbench.cli.options import Facts, FigureFormats, Printed, Protocol
from dfdbench.errors import refuse_alone, refuse_both
from dfdbench.results.output_place import output_place
from dfdbench.statuses import NO
from dfdbench.tables.table import Format, counted

if TYPE_CHECKING:
    from dfdbench.results.saved_run import SavedRun

_PANELS = 4
Dataset = Annotated[str | None, Option(help="Store; default: where the runs found it.")]


#: A page, or one table of methods beside metrics.
ReportFormat = Literal["html", "markdown", "table", "latex", "csv", "json"]
_PAGES = ("html", "markdown")
_TABLE = "--format table, latex, csv or json"


def report(
    results: Annotated[list[Path], Argument(help="Result files or runs' folders.")],
    out: Annotated[
        Path | None, Option(help="The page's folder (default: report), or a table's file.")
    ] = None,
    protocol: Protocol = None,
    format: Annotated[
        ReportFormat, Option(help="A page, html or markdown; or a table of methods beside metrics.")
    ] = "html",
    metric: Annotated[
        list[str] | None, Option(help="A column: nrmse, nmae, ssim, seconds; repeatable.")
    ] = None,
    figure: Annotated[
        Path | None, Option(metavar="FILE.png", help="Draw accuracy against seconds.")
    ] = None,
    figure_format: FigureFormats = None,
    dataset: Dataset = None,
) -> None:
    """Write a page about runs, pairs worst first, or a paper's table of them."""
    from dfdbench.results.record import RESULT, first_protocol
    from dfdbench.results.run_folder import PREVIOUS
    from dfdbench.results.saved_run import distinguished, open_saved_run

    refuse_both({f"--format {format}": format not in _PAGES}, {"--figure-format": figure_format})
    refuse_alone({"--metric": metric, "--figure": figure}, {_TABLE: format not in _PAGES})
    page = output_place(out or "report", *results) if out or format in _PAGES else None
    if figure:
        output_place(figure, *results, option="--figure")
    # Shells put a folder's tables beside its runs.
    results = [path for path in results if path.suffix == ".json" or not path.is_file()] or results
    once = {os.path.realpath(path / RESULT if path.is_dir() else path): path for path in results}
    paths = [path for path in once.values() if PREVIOUS not in path.name]
    if paths and len(paths) < len(once):
        screen.say(f"left out: earlier runs, NAME{PREVIOUS}; `dfdbench compare` takes two runs")
    runs = distinguished(open_saved_run(path, dataset) for path in paths or once.values())
    shown = protocol or first_protocol(runs[0].result.dataset.short)
    if page and format in _PAGES:
        _write_page(runs, shown, format, page, figure_format or ())
        return
    from dfdbench.report.paper_table import paper_tables

    tables = paper_tables(runs, shown, metric or ())
    if out is not None:
        from dfdbench.system.files import write_whole
        from dfdbench.tables.render import render

        write_whole(out, render(tables, Format(format)))
        screen.show("json" if format == "json" else None, text=str(out), file=out)
    else:
        screen.show(format, tables)
    if figure is not None:
        from dfdbench.figures.comparisons import accuracy_figure

        drawn = accuracy_figure(runs, shown)
        if drawn is None:
            screen.say("no figure: no run is complete")
        else:
            screen.save_figure(drawn, figure)


def _write_page(
    runs: Sequence[SavedRun], protocol: str, format: ReportFormat, folder: Path, also: Sequence[str]
) -> None:
    from dfdbench.report.page import write_html, write_markdown

    if format == "html":
        with screen.progress("drawing pairs", "the same command draws them anew") as step:
            path = write_html(runs, protocol, folder, step, also)
    else:
        path = write_markdown(runs, protocol, folder, also)
    for run in runs:
        if run.without:
            screen.say(f"no pictures of {run.label}: {run.without}")
    print(path)


def compare(
    first: Annotated[Path, Argument(metavar="A", help="A result file or a run's folder.")],
    second: Annotated[Path, Argument(metavar="B", help="Another on the same data.")],
    protocol: Protocol = None,
    most: Annotated[int, Option(min=1, help="How many changed pairs are listed.")] = 10,
    format: Printed = Format.table,
    out: Annotated[
        Path | None, Option(help="Draw changed pairs: a PNG, PDF or SVG, or a folder.")
    ] = None,
    dataset: Dataset = None,
) -> None:
    """Compare two runs pair by pair: differences, wins, losses, what changed most."""
    found = dfdbench.compare(first, second, protocol=protocol, dataset=dataset, most=most)
    runs = found.runs
    picture = output_place(_picture(out, *runs), first, second)
    (tables,) = found.tables.values()
    # A sheet holds one kind of row.
    screen.show(format, tables[:1] if format is Format.csv else tables)
    if format is Format.csv:
        screen.say("the pairs that changed most: --format json")
    figure = found.figure(min(most, _PANELS))
    if figure is None:
        why = "; ".join(dict.fromkeys(run.without for run in runs if run.without))
        screen.say(f"no panels: {why or 'no pair with depth maps changed'}")
        return
    screen.save_figure(figure, picture)


def _picture(out: Path | None, first: SavedRun, second: SavedRun) -> Path:
    if out is None:
        a, b = (_stem(run.label) for run in (first, second))
        dataset = first.result.dataset
        return Path("results") / f"compare-{dataset.name}-{dataset.split}-{a}-vs-{b}.png"
    return out / "compare.png" if out.is_dir() or not out.suffix else out


def _stem(label: str) -> str:
    plain = label.replace(" (", "-").replace(", ", "-").replace(")", "")
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_.=") else "_" for c in plain)[:80]


def leaderboard(
    context: Context,
    check: Annotated[
        bool, Option("--check", help="Change nothing; fail if a file is wrong or stale.")
    ] = False,
    format: Annotated[
        Format | None, Option(help="How the rankings are printed; default: table.")
    ] = None,
    dataset: Annotated[
        str | None, Option(metavar="NAME", help="Print all rankings of this data set, tracks too.")
    ] = None,
    folder: Annotated[
        Path | None, Option(help="The leaderboard's folder; outside a clone: the shipped rows.")
    ] = None,
) -> None:
    """Print the leaderboard's first rankings, the newest seed's on top; in a clone, write them."""
    if context.invoked_subcommand:
        return
    refuse_both({"--check": check}, {"--format": format, "--dataset": dataset})
    board = dfdbench.leaderboard(folder)
    if check:
        board.require_written()
        print(f"{board.folder}: {counted(len(board.rows), 'row')} valid, README up to date")
        return
    tables = board.tables(dataset)
    # What is shipped is the clone's to write.
    path = board.write() if folder or board.folder == LEADERBOARD else None
    screen.show(format, tables)
    if not dataset:
        screen.say("more         --dataset NAME prints every ranking of a data set, tracks too")
    screen.say(f"written      {path}" if path else f"rows of dfdbench {dfdbench.__version__}")


def verify_rows(
    rows: Annotated[list[Path], Argument(help="Files of leaderboard/results.")],
    pairs: Annotated[int, Option(min=1, help="How many pairs are run again.")] = 5,
    seed: Annotated[
        int | None, Option(min=0, max=2**32 - 1, help="Repeat this seed's draw; default: draw.")
    ] = None,
    tolerance: Annotated[
        float, Option(help="How far a score may be off, 0 to 1.")
    ] = SCORE_TOLERANCE,
    trust: Annotated[
        list[str] | None, Option(metavar="ENTRY", help="Run this code, too; repeatable.")
    ] = None,
    weights: Annotated[
        Path | None, Option(help="Your copy of weights that are not shipped.")
    ] = None,
    format: Facts = "table",
) -> None:
    """Run pairs of rows again, drawn anew each time; exit with 1 if something else comes out."""
    from dfdbench.board.row_file import read_row
    from dfdbench.board.submission import require_trusted, verify

    answers: list[dict[str, object]] = []
    found_rows = {path: read_row(path) for path in rows}
    require_trusted({p: r for p, r in found_rows.items() if not r.method.scored}, trust or ())
    for path, row in found_rows.items():
        if row.method.scored:
            screen.say(f"left out     {path}: scored, not run: there is nothing to run again")
            continue
        with screen.progress(f"verifying {path.stem}", "the same command draws anew") as step:
            found = verify(row, path, pairs, seed, tolerance, trust or (), weights, step)
        if format == "table":
            print(f"{'verified' if found.passed else 'DIFFERS':<12} {path}")
            drawn = f"{len(found.pairs)} of {found.drawn_from} pairs by --seed {found.seed}"
            print(f"drawn        {drawn}")
            for pair in found.pairs:
                print(f"{'same' if pair.passes(tolerance) else 'DIFFERENT':<12} {pair}")
        if not found.same_source:
            screen.say("the method's source file is not the one that the row was made with")
        answers.append({"row": path, "verified": found.passed, **asdict(found)})
    if format == "json":
        screen.show(format, rows=answers)
    if not all(answer["verified"] for answer in answers):
        raise Exit(NO)
