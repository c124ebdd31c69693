"""Show in the docs what each track costs each method, from the leaderboard.

`python docs/tracks_rows.py [DATASET-SPLIT]`, by default demo-1-test, after
`dfdbench tracks --method NAME --submit` of each method, or `python leaderboard/rerun.py --rows`:
the table and the picture of docs/tracks.md, a row and a line a method, by NRMSE under `valid`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from dfdbench.blur.tracks import CLEAN, SUITES
from dfdbench.board.board import leaderboard
from dfdbench.board.ranking import TRACKS_PROTOCOL, ScoreBoard
from dfdbench.figures.comparisons import tracks_figure
from dfdbench.figures.style import write_figure
from dfdbench.metrics.metric import RANKED_BY
from dfdbench.results.frame import track_means
from dfdbench.results.wording import NOTHING, score_text
from dfdbench.system.files import write_whole
from dfdbench.tables.render import as_markdown
from dfdbench.tables.table import Table

PAGE = Path(__file__).with_name("tracks.md")
PICTURE = Path(__file__).with_name("tracks_methods.png")
HARDEST = "camera-3"
GIVEN = "-given-blur"
BEGIN, END = "<!-- written by docs/tracks_rows.py -->\n", "<!-- end -->"


def main(place: str) -> None:
    """Write the page's table between its two marks, and draw the picture."""
    boards = {
        f"{board.result.dataset.name}-{board.result.dataset.split}": board
        for board in leaderboard().boards
        if len(SUITES.get(board.suite, ())) > 1
    }
    if place not in boards:
        sys.exit(f"no runs on tracks of {place}: dfdbench tracks --method NAME --submit")
    _write_between(PAGE, summary_of(boards))
    title = f"{place}, protocol {TRACKS_PROTOCOL}, best mean first"
    write_figure(tracks_figure(means_of(boards[place]), RANKED_BY, title), PICTURE)


def means_of(board: ScoreBoard) -> dict[str, pd.DataFrame]:
    """Return the means by track and severity of the methods with a complete set, best first."""
    overall = overall_of(board)
    rows = {standing.entry.label: row for row, standing in enumerate(board.standings)}
    return {
        label: track_means(
            board.scores[board.scores["row"] == rows[label]], TRACKS_PROTOCOL, RANKED_BY
        )
        for label in sorted(overall, key=overall.__getitem__)
    }


def overall_of(board: ScoreBoard) -> dict[str, float]:
    """Return the mean over all tracks of the methods with a complete set."""
    return {
        standing.entry.label: score
        for standing in board.standings
        if (score := standing.scores[RANKED_BY]) is not None
    }


def summary_of(boards: dict[str, ScoreBoard]) -> Table:
    """Return a row a method, best mean first: clean, hardest and mean, for each data set."""
    overall = {place: overall_of(board) for place, board in boards.items()}
    means = {place: means_of(board) for place, board in boards.items()}

    def order(label: str) -> tuple[bool, float]:
        return GIVEN in label, min(each[label] for each in overall.values() if label in each)

    def cells(place: str, label: str) -> tuple[str, ...]:
        if label not in means[place]:
            return (NOTHING,) * 3
        found, (track, severity) = means[place][label], HARDEST.split("-")
        scores = found[0].iloc[0], found[int(severity)][track], overall[place][label]
        return tuple(map(score_text, scores))

    labels = sorted({label for found in overall.values() for label in found}, key=order)
    rows = [
        (label, *(cell for place in boards for cell in cells(place, label))) for label in labels
    ]
    heads = [f"{place}: {CLEAN}" for place in boards]
    columns = ("", *(text for head in heads for text in (head, HARDEST, "mean of tracks")))
    align = "l" + "r" * (len(columns) - 1)
    return Table(f"NRMSE, protocol {TRACKS_PROTOCOL}", columns, tuple(rows), align)


def _write_between(page: Path, table: Table) -> None:
    before, _, rest = page.read_text("utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    write_whole(page, f"{before}{BEGIN}\n{as_markdown(table)}\n{END}{after}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "demo-1-test")
