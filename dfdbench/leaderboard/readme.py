"""The leaderboard's README: write it, or say that it is stale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path

import jinja2

from dfdbench.errors import Problem, ResultError
from dfdbench.leaderboard.board_tables import board_tables
from dfdbench.leaderboard.boards import Entry, ScoreBoard, collect, parted
from dfdbench.leaderboard.folder import README, read_own_text
from dfdbench.leaderboard.published import PublishedTable, load_published
from dfdbench.leaderboard.published_tables import published_summary, published_table
from dfdbench.leaderboard.scored_table import scored_table
from dfdbench.leaderboard.track_board_tables import tracks_board_table
from dfdbench.leaderboard.track_boards import TracksBoard, TracksEntry, collect_tracks, track_boards
from dfdbench.metrics.metric import IN_METRES
from dfdbench.metrics.protocol import ranked_by
from dfdbench.results.told import told
from dfdbench.system.files import write_whole
from dfdbench.tables.render import as_markdown, escape_markdown

NOTE = "note.md"


def write_readme(folder: Path) -> Path:
    """Write the leaderboard's README; return its path.

    Raises
    ------
    ResultError
        With everything that is wrong in the results and published tables.
    """
    path = folder / README
    write_whole(path, readme_text(folder, *collect_all(folder)))
    return path


def check_readme(folder: Path) -> int:
    """Refuse a leaderboard with a wrong file, or whose README is not what its files say.

    Returns
    -------
    int
        How many results there are.

    Raises
    ------
    ResultError
        With everything that is wrong.
    """
    entries, tracked = collect_all(folder)
    expected = readme_text(folder, entries, tracked)
    path = folder / README
    found = read_own_text(path).replace("\r\n", "\n")
    if found != expected:
        raise ResultError(
            "the leaderboard's README is stale",
            where=f"{path}, line {_first(found, expected)}",
            fix="dfdbench leaderboard, and commit what it wrote",
        )
    return len(entries) + len(tracked)


def collect_all(folder: Path) -> tuple[list[Entry], list[TracksEntry]]:
    """Read every file of a leaderboard: single results, and runs on tracks.

    Raises
    ------
    ResultError
        With everything that is wrong in any of the files.
    """
    problems: list[Problem] = []
    entries: list[Entry] = []
    tracked: list[TracksEntry] = []
    try:
        entries = collect(folder)
    except ResultError as error:
        problems += error.problems
    try:
        tracked = collect_tracks(folder)
    except ResultError as error:
        problems += (problem for problem in error.problems if problem not in problems)
    if problems:
        raise ResultError.of(problems)
    return entries, tracked


def readme_text(folder: Path, entries: Sequence[Entry], tracked: Sequence[TracksEntry] = ()) -> str:
    """Return what the README is to say of these entries.

    Raises
    ------
    ResultError
        Where a published table cannot be read.
    """
    found, scored = parted(entries)
    published = load_published(folder)
    note = read_own_text(folder / NOTE).replace("\r\n", "\n")
    template = resources.files("dfdbench.leaderboard") / "leaderboard.md.jinja"
    # Markdown, not HTML: what comes from results is escaped by as_markdown, table by table.
    environment = jinja2.Environment(keep_trailing_newline=True, undefined=jinja2.StrictUndefined)
    compared = dict.fromkeys(table.compare for table in published if table.compare)
    text = environment.from_string(template.read_text(encoding="utf-8")).render(
        note=note.rstrip(),
        boards=[_board_context(board, folder) for board in found],
        tracks=[_tracks_context(board, folder) for board in track_boards(tracked)],
        lens_told=any("lens told" in told(entry.result) for entry in entries),
        in_metres=any(ranked_by(board.protocol)[0] in IN_METRES for board in found),
        scored=[as_markdown(scored_table(board, folder)) for board in scored],
        summaries=[as_markdown(published_summary(published, name)) for name in compared],
        published=[_published_context(table) for table in published],
        citation=escape_markdown(published[0].citation) if published else "",
        doi=published[0].doi if published else "",
    )
    return text.rstrip("\n") + "\n"


def _board_context(board: ScoreBoard, folder: Path) -> dict[str, object]:
    ranking, *others = board_tables(board, folder)
    return {
        "heading": escape_markdown(ranking.title),
        "fingerprint": board.fingerprint,
        "headline": board.headline,
        "tables": [as_markdown(table) for table in (replace(ranking, title="ranking"), *others)],
    }


def _tracks_context(board: TracksBoard, folder: Path) -> dict[str, str]:
    table = tracks_board_table(board, folder)
    return {
        "heading": escape_markdown(table.title),
        "table": as_markdown(replace(table, title="ranking")),
    }


def _published_context(table: PublishedTable) -> dict[str, str]:
    return {
        "summary": escape_markdown(f"{table.name}: {table.title}"),
        "text": as_markdown(published_table(table)),
    }


def _first(found: str, expected: str) -> int:
    lines = zip(found.splitlines(), expected.splitlines(), strict=False)
    differing = (number for number, (a, b) in enumerate(lines, 1) if a != b)
    return next(differing, min(found.count("\n"), expected.count("\n")) + 1)
