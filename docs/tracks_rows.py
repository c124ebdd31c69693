"""Show in the docs what each track costs each method, from the leaderboard.

`python docs/tracks_rows.py [DATASET-SPLIT]`, by default demo-1-test, after
`dfdbench tracks --method NAME --submit` of each method, or `make leaderboard`, which runs all of
them: docs/classical.md's table, a row a track and severity, and the picture of docs/tracks.md, a
line a method. NRMSE under protocol `valid`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from dfdbench.blur.tracks import CLEAN, SUITES
from dfdbench.figures.style import write_figure
from dfdbench.figures.tracks import tracks_figure
from dfdbench.leaderboard.board import leaderboard
from dfdbench.leaderboard.ranking import TRACKS_PROTOCOL, ScoreBoard
from dfdbench.metrics.metric import RANKED_BY
from dfdbench.results.track_tables import track_means
from dfdbench.results.wording import score_text
from dfdbench.system.files import write_whole
from dfdbench.tables.render import as_markdown
from dfdbench.tables.table import Table

PAGE = Path(__file__).with_name("classical.md")
PICTURE = Path(__file__).with_name("tracks_methods.png")
METHODS = ("constant", "s-transform", "rational-filters", "favaro-soatto", "guided", "sgm", "local")
BEGIN, END = "<!-- written by docs/tracks_rows.py -->\n", "<!-- end -->"


def main(place: str) -> None:
    """Write the table between its two marks, and draw the picture."""
    means = {
        label: found
        for board in leaderboard().boards
        if board.suite in SUITES
        and f"{board.result.dataset.name}-{board.result.dataset.split}" == place
        for label, found in means_of(board).items()
    }
    there = {name: means[name] for name in METHODS if name in means}
    if lacking := [name for name in METHODS if name not in means]:
        print(f"no runs on tracks of {place}: {', '.join(lacking)}", file=sys.stderr)
    if not there:
        sys.exit("nothing is written; dfdbench tracks --method NAME --submit")
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    write_whole(PAGE, f"{before}{BEGIN}\n{as_markdown(table_of(there, place))}\n{END}{after}")
    title = f"{place}, protocol {TRACKS_PROTOCOL}, best mean first"
    write_figure(tracks_figure(means, RANKED_BY, title), PICTURE)


def means_of(board: ScoreBoard) -> dict[str, pd.DataFrame]:
    """Return the means by track and severity of the methods with a complete set, best first."""
    complete = {
        standing.entry.label: (standing.scores[RANKED_BY], row)
        for row, standing in enumerate(board.standings)
        if standing.scores[RANKED_BY] is not None
    }
    return {
        label: track_means(board.scores[board.scores["row"] == row], TRACKS_PROTOCOL, RANKED_BY)
        for label, (_, row) in sorted(complete.items(), key=lambda item: item[1])
    }


def table_of(means: dict[str, pd.DataFrame], place: str) -> Table:
    """Return a row a track and severity, a column a method."""
    first = next(iter(means.values()))
    rows = [(CLEAN, *(score_text(found[0].iloc[0]) for found in means.values()))]
    for track in first.index:
        for severity in first.columns[1:]:
            scores = (score_text(found[severity][track]) for found in means.values())
            rows.append((f"{track}-{severity}", *scores))
    title = f"NRMSE, {place}, protocol {TRACKS_PROTOCOL}"
    return Table(title, ("", *means), tuple(rows), "l" + "r" * len(means))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "demo-1-test")
