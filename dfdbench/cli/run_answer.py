"""What is printed of a run: its tables, where its files lie, its scores."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dfdbench.cli.screen import print_table, say
from dfdbench.tables.table import Format
from dfdbench.tables.wording import counted, listed

if TYPE_CHECKING:
    from dfdbench.datasets.manifest import Manifest
    from dfdbench.evaluation.run import Run
    from dfdbench.results.summary import RunSummary


def print_run_tables(summary: RunSummary, manifest: Manifest, format: Format) -> None:
    """Print a run's tables in a format."""
    from dfdbench.results.run_data import run_as_csv, run_as_json
    from dfdbench.results.scene_tables import all_tables
    from dfdbench.results.summary import scene_labels
    from dfdbench.tables.render import render

    if format is Format.csv:
        print(run_as_csv(summary, scene_labels(manifest.scenes)), end="")
        return
    if format is Format.json:
        print(run_as_json(summary, scene_labels(manifest.scenes)), end="")
        return
    tables = all_tables(summary, manifest.scenes, manifest.splits)
    if format is Format.table:
        for table in tables:
            print_table(table)
    else:
        print(render(tables, format), end="")


def tell_what_was_reused(done: Run) -> None:
    """Say what of an earlier call was kept, and where one of other settings lies."""
    if done.because:
        say(f"started over: {listed(done.because, most=5)}")
    if done.set_aside:
        say(f"the earlier run was moved to {done.set_aside}")
    if done.reused:
        pairs = counted(done.reused, "pair")
        say(f"{pairs} taken over from an earlier call (--fresh evaluates anew)")


def tell_where_it_lies(done: Run, figures: bool) -> None:
    """Say where a run's files lie, and what failed."""
    from dfdbench.results.record_file import RESULT

    method = done.result.method
    if method.fitted_on:
        say(f"fitted       on {method.fitted_on}, in {method.fit_seconds:.1f} s")
    say(f"result       {done.folder / RESULT}")
    if figures:
        say(f"figures      {done.folder / 'figures'}")
    failed = sum(pair.status == "failed" for pair in done.result.pairs)
    if failed:
        again = "it" if failed == 1 else "them"
        say(f"{counted(failed, 'pair')} failed; the same command tries {again} again")


def tell_overall(summary: RunSummary) -> None:
    """Say last what one wants first: a run's scores over all pairs, or that it has none."""
    from dfdbench.metrics.metric import find_metric
    from dfdbench.results.wording import score_text

    data = summary.result.dataset
    under = f"protocol {summary.protocol}, split {data.split}"
    averages = (summary.result.averages or {}).get(summary.protocol)
    if averages is None:
        done = f"{data.evaluated} of {counted(data.expected, 'pair')}"
        missing = sum(pair.status == "missing" for pair in summary.result.pairs)
        why = f"; {counted(missing, 'pair')} not in the store" if missing else ""
        say(f"overall      no score: {done} were evaluated{why}  ({under})")
        return
    scores = "  ".join(f"{find_metric(n).title} {score_text(v)}" for n, v in averages.items())
    say(f"overall      {scores}  ({under}, {counted(data.expected, 'pair')})")
