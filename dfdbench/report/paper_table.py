"""A table of methods and metrics for a paper, with the best values marked."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from dfdbench.board.ranking import Entry, ScoreBoard, Standing, boards
from dfdbench.errors import unknown_name
from dfdbench.metrics.protocol import metrics_of, require_scored, title_of
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.wording import SECONDS_NOTE, given_to, score_text, seconds_text
from dfdbench.system.packages import PACKAGE_VERSION
from dfdbench.tables.table import Marked, Table, counted

SECONDS = "seconds"
# How many of a fingerprint's 64 digits to show: enough to be unique, few enough for a caption.
_DIGITS = 16


def paper_tables(
    runs: Sequence[SavedRun], protocol: str, columns: Sequence[str] = ()
) -> list[Table]:
    """Return a table for each set of comparable runs: on one fingerprint and split.

    Parameters
    ----------
    runs : sequence of SavedRun
        At least one; `dfdbench.results.saved_run.distinguished` gives runs of one method unique
        names.
    protocol : str
        The protocol.
    columns : sequence of str
        Metrics by name, and ``seconds``, in this order; all by default.

    Raises
    ------
    UnknownNameError
        If a run was not scored under the protocol, or the protocol has no such metric.
    """
    for run in runs:
        require_scored(protocol, run.result.protocol_names, str(run.path))
    there = (*metrics_of(protocol), SECONDS)
    for name in columns:
        if name not in there:
            raise unknown_name(f"metric of protocol {protocol}", name, there)
    shown = tuple(dict.fromkeys(columns or there))
    found = boards([Entry((run.result,), run.path, run.label) for run in runs])
    tables = [_table(board, shown) for board in found if board.protocol == protocol]
    # LaTeX rejects duplicate labels: two builds of a set share a name but not their data.
    labels = [table.label for table in tables]
    return [
        replace(table, label=f"{table.label} {table.records[0]['fingerprint']!s:.8}")
        if labels.count(table.label) > 1
        else table
        for table in tables
    ]


def _table(board: ScoreBoard, names: Sequence[str]) -> Table:
    metrics = metrics_of(board.protocol)
    cells = {name: _cells(board, name) for name in names}
    rows = tuple(
        (standing.entry.label, given_to(standing.entry.result), *(cells[name][n] for name in names))
        for n, standing in enumerate(board.standings)
    )
    headings = ("seconds per pair" if name == SECONDS else metrics[name].heading for name in names)
    dataset = board.result.dataset
    pairs = max(standing.entry.result.dataset.expected for standing in board.standings)
    scenes = board.scores["scene"].nunique()
    title = (
        f"{dataset.name}, split {dataset.split} "
        f"({counted(pairs, 'pair')} of {counted(scenes, 'scene')}), "
        f"protocol {title_of(board.protocol)}, data {dataset.fingerprint[:_DIGITS]}, "
        f"dfdbench {PACKAGE_VERSION}"
    )
    columns = ("method", "given", *headings)
    notes, label = tuple(_notes(board, names)), f"{dataset.name} {dataset.split} {board.protocol}"
    records = tuple(_record(board, standing, names) for standing in board.standings)
    return Table(title, columns, rows, "ll", notes, records=records, label=label)


def _cells(board: ScoreBoard, name: str) -> list[str]:
    """Return a column: the best ranked value marked, means of incomplete runs in brackets."""
    if name == SECONDS:
        return [seconds_text(standing.entry.seconds) for standing in board.standings]
    texts = [board.shown(row, name) for row in range(len(board.standings))]
    metric = metrics_of(board.protocol)[name]
    ranked = {
        score_text(value): value
        for standing in board.standings
        if standing.rank is not None and (value := standing.scores.get(name)) is not None
    }
    # Values that print alike are equal: a reader sees no more digits.
    order = sorted(
        ranked, key=lambda text: metric.compared(ranked[text]), reverse=metric.larger_is_better
    )
    marks = dict(zip(order, ("best", "second"), strict=False)) if len(ranked) > 1 else {}
    return [
        Marked(text, marks[text]) if text in marks and standing.rank is not None else text
        for text, standing in zip(texts, board.standings, strict=True)
    ]


def _notes(board: ScoreBoard, names: Sequence[str]) -> list[str]:
    notes = []
    if sum(standing.rank is not None for standing in board.standings) > 1:
        notes.append("Best bold, second underlined.")
    if SECONDS in names:
        notes.append(SECONDS_NOTE)
    unranked = (standing.entry for standing in board.standings if standing.rank is None)
    return notes + [f"{entry.label}: {entry.unranked(board.protocol)}" for entry in unranked]


def _record(board: ScoreBoard, standing: Standing, names: Sequence[str]) -> Mapping[str, object]:
    entry = standing.entry
    dataset = entry.result.dataset
    scores = {
        name: entry.seconds if name == SECONDS else standing.scores.get(name) for name in names
    }
    return {
        "dataset": dataset.name,
        "split": dataset.split,
        "protocol": board.protocol,
        "fingerprint": dataset.fingerprint,
        "rank": standing.rank,
        "method": entry.label,
        "given": given_to(entry.result),
        **scores,
        "pairs": f"{dataset.evaluated}/{dataset.expected}",
    }
