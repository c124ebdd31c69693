"""The content of a report in any form: headings, tables, plots, and pairs worst first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from dfdbench.board.ranking import Entry, ScoreBoard, boards
from dfdbench.board.tables import lighting_table, runs_table, standings_table
from dfdbench.figures.comparisons import accuracy_figure, lighting_figures, time_figure
from dfdbench.figures.runs import group_figures
from dfdbench.figures.style import write_forms
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import ranked_by, require_scored
from dfdbench.results.record import PairResult
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.scene_tables import all_tables
from dfdbench.results.summary import RunSummary, summarise
from dfdbench.results.wording import score_text
from dfdbench.tables.table import Table


@dataclass(frozen=True)
class Section:
    """Runs that may be compared: of one data set fingerprint and split.

    `tables` are the ranking, the scores by lighting and how the runs were made; `details` each
    method's own tables, by its label; `plots` are by what each shows.
    """

    heading: str
    fingerprint: str
    tables: tuple[Table, ...]
    details: tuple[tuple[str, tuple[Table, ...]], ...]
    plots: dict[str, Figure]


@dataclass(frozen=True)
class Content:
    """All that a report says.

    Parameters
    ----------
    title : str
        What it is about.
    protocol : str
        The protocol of every score.
    summary : tuple of str
        A sentence a section.
    methods : tuple of str
        The methods' labels, best first.
    sections : tuple of Section
        One for each set of comparable runs.
    pairs : tuple of (SavedRun, PairResult)
        Pairs whose images can be shown, worst first by the ranking metric.
    missing : tuple of str
        Runs without a gallery, and why.
    """

    title: str
    protocol: str
    summary: tuple[str, ...]
    methods: tuple[str, ...]
    sections: tuple[Section, ...]
    pairs: tuple[tuple[SavedRun, PairResult], ...]
    missing: tuple[str, ...]


def gather(runs: Sequence[SavedRun], protocol: str) -> Content:
    """Gather the content of a report on at least one run.

    Raises
    ------
    UnknownNameError
        If a run was not scored under the protocol.
    """
    for run in runs:
        require_scored(protocol, run.result.protocol_names, str(run.path))
    found = boards([Entry.of(run.result, run.path, run.place) for run in runs])
    sections, sentences = [], []
    shown: list[tuple[SavedRun, RunSummary]] = []
    for board in found:
        if board.protocol != protocol:
            continue
        members = _members_of(board, runs)
        summaries = [(run, summarise(run.result, protocol)) for run in members]
        section = _section_of(board, summaries, runs[0].path.parent)
        shown += summaries
        sections.append(section)
        sentences.append(_sentence(members, protocol, section.heading))
    labels = list(dict.fromkeys(run.label for run, _ in shown))
    title = labels[0] if len(labels) == 1 else f"{len(labels)} methods"
    return Content(
        f"Depth from defocus: {title}",
        protocol,
        tuple(sentences),
        tuple(labels),
        tuple(sections),
        _worst_first(shown),
        tuple(f"{run.label}: {run.without}" for run, _ in shown if run.without),
    )


def _members_of(board: ScoreBoard, runs: Sequence[SavedRun]) -> list[SavedRun]:
    paths = [standing.entry.path for standing in board.standings]
    return sorted((r for r in runs if r.path in paths), key=lambda r: paths.index(r.path))


def _section_of(
    board: ScoreBoard, summaries: Sequence[tuple[SavedRun, RunSummary]], folder: Path
) -> Section:
    members = [run for run, _ in summaries]
    manifest = next((run.store.manifest for run in members if run.store), None)
    scenes, splits = (manifest.scenes, manifest.splits) if manifest else ([], [])
    details = tuple(
        (run.label, tuple(all_tables(summary, scenes, splits))) for run, summary in summaries
    )
    plots = lighting_figures(members, board.protocol)
    parted = group_figures({run.label: run.result for run in members}, board.protocol, scenes)
    plots |= {f"by {what}": figure for what, figure in parted.items()}
    if (times := time_figure(members)) is not None:
        plots["seconds per pair"] = times
    if len(members) > 1 and (accuracy := accuracy_figure(members, board.protocol)) is not None:
        plots["accuracy and seconds"] = accuracy
    ranking = standings_table(board, folder)
    tables = (ranking, lighting_table(board), runs_table(board))
    return Section(ranking.title, board.result.dataset.fingerprint, tables, details, plots)


def _sentence(members: Sequence[SavedRun], protocol: str, where: str) -> str:
    scored = [run for run in members if run.result.averages]
    if not scored:
        return f"{where}: no run is complete."
    best = scored[0].result.averages or {}
    parts = [
        f"{find_metric(name).title} {score_text(value)}"
        for name, value in best[protocol].items()
        if value
    ]
    lead = "" if len(scored) == 1 else f"best of {len(scored)}: "
    return f"{where}: {lead}{scored[0].label}, {', '.join(parts)}."


def _worst_first(
    runs: Sequence[tuple[SavedRun, RunSummary]],
) -> tuple[tuple[SavedRun, PairResult], ...]:
    def score(shown: tuple[SavedRun, RunSummary, PairResult]) -> float:
        _, summary, pair = shown
        return pair.score(summary.protocol, ranked_by(summary.protocol)[0]) or 0.0

    kept = [(run, summary) for run, summary in runs if run.store is not None]
    found = [(run, summary, pair) for run, summary in kept for pair in summary.ranked]
    return tuple((run, pair) for run, _, pair in sorted(found, key=score, reverse=True))


def write_plots(
    content: Content, folder: Path, forms: Sequence[str]
) -> list[list[tuple[str, str]]]:
    """Write each section's plots as ``1-seconds-per-pair.png`` in each form: png, pdf, svg.

    Return them by section, as (what, file of the first form).
    """
    written = []
    for number, section in enumerate(content.sections, 1):
        stems = {name: f"{number}-{name.replace(' ', '-')}" for name in section.plots}
        for name, figure in section.plots.items():
            write_forms(figure, folder, stems[name], forms)
        written.append([(name, f"{stem}.{forms[0]}") for name, stem in stems.items() if forms])
    return written
