"""Show in the docs what each track costs each method, from the leaderboard.

`python docs/tracks_rows.py [DATASET-SPLIT]`, by default demo-1-test, after
`dfdbench tracks --method NAME --submit` of each method, or `make leaderboard`, which runs all of
them: docs/classical.md's table, a row a track and severity; the table and the picture of
docs/tracks.md, a row and a line a method. NRMSE under protocol `valid`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from matplotlib.figure import Figure

from dfdbench.blur.tracks import CLEAN, TRACKS
from dfdbench.figures.comparisons import tracks_figure
from dfdbench.figures.style import write_figure
from dfdbench.leaderboard.folder import LEADERBOARD
from dfdbench.leaderboard.track_boards import TracksEntry, collect_tracks
from dfdbench.leaderboard.tracks_submission import HEADLINE
from dfdbench.metrics.metric import RANKED_BY
from dfdbench.results.track_tables import severities
from dfdbench.results.wording import NOTHING, score_text
from dfdbench.system.files import write_whole
from dfdbench.tables.render import as_markdown
from dfdbench.tables.table import Table

PAGE = Path(__file__).with_name("classical.md")
SUMMARY = Path(__file__).with_name("tracks.md")
PICTURE = Path(__file__).with_name("tracks_methods.png")
METHODS = ("constant", "s-transform", "rational-filters", "favaro-soatto", "guided", "sgm", "local")
HARDEST = "camera-3"
GIVEN = ", given "
BEGIN, END = "<!-- written by docs/tracks_rows.py -->\n", "<!-- end -->"


def main(place: str) -> None:
    """Write each page's table between its two marks, and draw the picture."""
    places: dict[str, dict[str, TracksEntry]] = {}
    for entry in collect_tracks(LEADERBOARD):
        places.setdefault(_place(entry), {})[entry.label] = entry
    entries = places.get(place, {})
    there = [name for name in METHODS if name in entries]
    if lacking := [name for name in METHODS if name not in entries]:
        print(f"no runs on tracks of {place}: {', '.join(lacking)}", file=sys.stderr)
    if not there:
        sys.exit("nothing is written; dfdbench tracks --method NAME --submit")
    _write_between(PAGE, table_of([entries[name] for name in there], place))
    _write_between(SUMMARY, summary_of(places))
    write_figure(picture_of(list(entries.values()), place), PICTURE)


def table_of(entries: list[TracksEntry], place: str) -> Table:
    """Return a row a track and severity, a column a method."""
    rows = [(CLEAN, *(_score(entry, CLEAN) for entry in entries))]
    for track in TRACKS.values():
        for severity in range(1, len(track.severities) + 1):
            label = f"{track.name}-{severity}"
            rows.append((label, *(_score(entry, label) for entry in entries)))
    columns = ("", *(entry.label for entry in entries))
    title = f"NRMSE, {place}, protocol {HEADLINE}"
    return Table(title, columns, tuple(rows), "l" + "r" * len(entries))


def summary_of(places: dict[str, dict[str, TracksEntry]]) -> Table:
    """Return a row a method, best mean first: clean, hardest and mean, for each data set."""

    def order(label: str) -> tuple[bool, float]:
        means = [found[label].mean(RANKED_BY) for found in places.values() if label in found]
        return GIVEN in label, min((mean for mean in means if mean is not None), default=1)

    def cells(entry: TracksEntry | None) -> tuple[str, ...]:
        if entry is None:
            return (NOTHING,) * 3
        return _score(entry, CLEAN), _score(entry, HARDEST), score_text(entry.mean(RANKED_BY))

    labels = sorted({label for found in places.values() for label in found}, key=order)
    rows = [
        (label, *(cell for found in places.values() for cell in cells(found.get(label))))
        for label in labels
    ]
    heads = [f"{place}: {CLEAN}" for place in places]
    columns = ("", *(text for head in heads for text in (head, HARDEST, "mean of tracks")))
    align = "l" + "r" * (len(columns) - 1)
    return Table(f"NRMSE, protocol {HEADLINE}", columns, tuple(rows), align)


def picture_of(entries: list[TracksEntry], place: str) -> Figure:
    """Return the metric against severity, a panel a track, a line a method, best mean first."""
    whole = [(mean, entry) for entry in entries if (mean := entry.mean(RANKED_BY)) is not None]
    scores = {
        entry.label: severities(entry.results, HEADLINE, RANKED_BY)
        for _, entry in sorted(whole, key=lambda found: found[0])
    }
    return tracks_figure(scores, RANKED_BY, f"{place}, protocol {HEADLINE}, best mean first")


def _place(entry: TracksEntry) -> str:
    return f"{entry.clean.dataset.name}-{entry.clean.dataset.split}"


def _write_between(page: Path, table: Table) -> None:
    before, _, rest = page.read_text("utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    write_whole(page, f"{before}{BEGIN}\n{as_markdown(table)}\n{END}{after}")


def _score(entry: TracksEntry, label: str) -> str:
    result = entry.results.get(label)
    return score_text(((result and result.averages) or {}).get(HEADLINE, {}).get(RANKED_BY))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "demo-1-test")
