"""Show in the docs what each track costs each method, from the leaderboard.

`python docs/tracks_rows.py [DATASET-SPLIT]`, by default demo-1-test, after
`dfdbench tracks --method NAME --submit` of each method, or `python leaderboard/rerun.py --rows`:
the table and the picture of docs/tracks.md, a row and a line a method, by NRMSE under `valid`.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import pandas as pd

from dfdbench.blur.tracks import CLEAN
from dfdbench.board.board import leaderboard
from dfdbench.board.ranking import TRACKS_PROTOCOL, ScoreBoard
from dfdbench.figures.comparisons import tracks_figure
from dfdbench.figures.style import write_figure
from dfdbench.metrics.metric import RANKED_BY
from dfdbench.results.frame import track_means
from dfdbench.results.wording import score_text
from dfdbench.system.files import write_whole
from dfdbench.tables.render import as_markdown
from dfdbench.tables.table import Table

PAGE = Path(__file__).with_name("tracks.md")
PICTURE = Path(__file__).with_name("tracks_methods.png")
#: By suite, the track that is shown alone.
SHOWN = {"tracks-1": "camera-3", "tracks-2": "lens-2"}
#: A data set with its split, and a suite of tracks or a column.
Place = tuple[str, str]
GIVEN = "-given-blur"
BEGIN, END = "<!-- written by docs/tracks_rows.py -->\n", "<!-- end -->"


def main(place: str) -> None:
    """Write the page's table between its two marks, and draw the picture."""
    boards = {
        (f"{board.result.dataset.name}-{board.result.dataset.split}", board.suite): board
        for board in leaderboard().boards
        if board.suite in SHOWN
    }
    drawn = place, next(iter(SHOWN))
    if drawn not in boards:
        sys.exit(f"no runs on tracks of {place}: dfdbench tracks --method NAME --submit")
    _write_between(PAGE, summary_of(boards))
    title = f"{place}, protocol {TRACKS_PROTOCOL}, best mean first"
    write_figure(tracks_figure(means_of(boards[drawn]), RANKED_BY, title), PICTURE)


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


def summary_of(boards: dict[Place, ScoreBoard]) -> Table:
    """Return a row a method, best mean first: clean, one track and mean, for each suite."""
    columns: dict[Place, dict[str, float]] = {}
    best: dict[str, float] = {}
    for (place, suite), board in boards.items():
        means, overall = means_of(board), overall_of(board)
        track, severity = SHOWN[suite].split("-")
        clean = columns.setdefault((place, CLEAN), {})
        clean |= {label: found[0].iloc[0] for label, found in means.items()}
        columns[place, SHOWN[suite]] = {k: each[int(severity)][track] for k, each in means.items()}
        columns[place, f"mean of {suite}"] = overall
        best |= {label: min(best.get(label, math.inf), mean) for label, mean in overall.items()}
    labels = sorted(best, key=lambda label: (GIVEN in label, best[label]))
    rows = [(k, *(score_text(each.get(k)) for each in columns.values())) for k in labels]
    heads = ("", *(f"{place}: {text}" if text == CLEAN else text for place, text in columns))
    align = "l" + "r" * (len(heads) - 1)
    return Table(f"NRMSE, protocol {TRACKS_PROTOCOL}", heads, tuple(rows), align)


def _write_between(page: Path, table: Table) -> None:
    before, _, rest = page.read_text("utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    write_whole(page, f"{before}{BEGIN}\n{as_markdown(table)}\n{END}{after}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "demo-1-test")
