"""What a report says, whatever its form: headings, tables, plots, and pairs worst first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from dfdbench.figures.comparison import accuracy_figure, lighting_figures, time_figure
from dfdbench.figures.groups import group_figures
from dfdbench.leaderboard.board_tables import lighting_table, runs_table, standings_table
from dfdbench.leaderboard.boards import Entry, ScoreBoard, boards
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

    Parameters
    ----------
    heading, fingerprint : str
        Which data.
    tables : tuple of Table
        Ranking, scores by lighting, how they were run.
    details : tuple of (str, tuple of Table)
        Each method's own tables, by its label.
    plots : dict of str to Figure
        By what each shows.
    """

    heading: str
    fingerprint: str
    tables: tuple[Table, ...]
    details: tuple[tuple[str, tuple[Table, ...]], ...]
    plots: dict[str, Figure]


@dataclass(frozen=True)
class ShownPair:
    """A pair of a run whose images can be shown."""

    run: SavedRun
    pair: PairResult


@dataclass(frozen=True)
class Content:
    """All that a report says.

    Parameters
    ----------
    title, summary : str, tuple of str
        What it is about, in a line and in a few.
    protocol : str
        Under which everything is scored.
    methods : tuple of str
        The methods' labels, best first.
    sections : tuple of Section
        One for each set of comparable runs.
    pairs : tuple of ShownPair
        Worst first, by what ranks under the protocol.
    missing : tuple of str
        Runs without a gallery, and why.
    """

    title: str
    protocol: str
    summary: tuple[str, ...]
    methods: tuple[str, ...]
    sections: tuple[Section, ...]
    pairs: tuple[ShownPair, ...]
    missing: tuple[str, ...]


def gather(runs: Sequence[SavedRun], protocol: str) -> Content:
    """Gather what a report on these runs says.

    Parameters
    ----------
    runs : sequence of SavedRun
        At least one.
    protocol : str
        Under which protocol.

    Raises
    ------
    UnknownNameError
        Where a run was not scored under that protocol.
    """
    for run in runs:
        require_scored(protocol, run.result.protocol_names, str(run.path))
    found = boards([Entry(run.result, run.path, None, run.place) for run in runs])
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
    return Section(ranking.title, board.fingerprint, tables, details, plots)


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


def _worst_first(runs: Sequence[tuple[SavedRun, RunSummary]]) -> tuple[ShownPair, ...]:
    found = [
        (pair.score(summary.protocol, ranked_by(summary.protocol)[0]) or 0.0, ShownPair(run, pair))
        for run, summary in runs
        if run.store is not None
        for pair in summary.ranked
    ]
    return tuple(shown for _, shown in sorted(found, key=lambda item: -item[0]))
