"""The table of a board over tracks: clean beside each track's mean, ranked by the mean of all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from dfdbench.blur.tracks import CLEAN, TRACKS
from dfdbench.datasets.catalog import released_manifests
from dfdbench.datasets.tracked import part_name
from dfdbench.leaderboard.folder import link_to
from dfdbench.leaderboard.track_boards import TracksBoard, TracksEntry
from dfdbench.leaderboard.tracks_submission import HEADLINE
from dfdbench.metrics.metric import METRICS, RANKED_BY
from dfdbench.metrics.protocol import title_of
from dfdbench.results.record import Result
from dfdbench.results.wording import NOTHING, parameters_of, score_text
from dfdbench.tables.table import Link, Table

_THIS_TRACK = "this track"


def tracks_board_table(board: TracksBoard, folder: Path) -> Table:
    """Return a row a method: clean, each track's mean over severities, the mean over tracks.

    Parameters
    ----------
    board : TracksBoard
        From `dfdbench.leaderboard.track_boards.track_boards`.
    folder : Path
        The leaderboard's folder, from which links go out.
    """
    columns = (
        "",
        "method",
        CLEAN,
        *TRACKS,
        "mean of tracks",
        "fitted on",
        "trained on",
        "status",
        "file",
    )
    rows = tuple(
        (
            NOTHING if rank is None else str(rank),
            entry.label,
            score_text(_clean(entry, RANKED_BY)),
            *map(score_text, entry.means(RANKED_BY).values()),
            score_text(entry.mean(RANKED_BY)),
            fitted_on(entry),
            trained_on(entry),
            entry.status,
            Link("result", link_to(entry.path, folder)),
        )
        for rank, entry in board.rows
    )
    return Table(
        f"{board.dataset}, split {board.split}, all tracks, protocol {title_of(HEADLINE)}: "
        f"{METRICS[RANKED_BY].heading}",
        columns,
        rows,
        "rl" + "r" * (len(TRACKS) + 2) + "llll",
        tuple(_notes(board)),
        records=tuple(_record(board, rank, entry, folder) for rank, entry in board.rows),
    )


def fitted_on(entry: TracksEntry) -> str:
    """Return what a method was fitted on before its runs on tracks."""
    return _seen(entry, lambda result: result.method.fitted_on)


def trained_on(entry: TracksEntry) -> str:
    """Return what a method was trained on before its runs on tracks."""
    return _seen(entry, lambda result: result.method.trained_on)


def _seen(entry: TracksEntry, text_of: Callable[[Result], str | None]) -> str:
    texts = [_in_short(text_of(result), result.dataset.name) for result in entry.on_tracks]
    return "; ".join(sorted({text for text in texts if text})) or NOTHING


def _in_short(text: str | None, dataset: str) -> str:
    if text is None:
        return ""
    name, _, rest = text.partition(", ")
    if name == dataset:
        return _THIS_TRACK
    base, track = part_name(name)
    synthetic = {m.stem for m in released_manifests() if m.recipe is not None}
    # What follows the split tells a training that was not on clean images.
    if base not in synthetic or track or ", " in rest:
        return text
    return CLEAN if base == part_name(dataset)[0] else f"{CLEAN} {base}"


def _clean(entry: TracksEntry, metric: str) -> float | None:
    return (entry.clean.averages or {}).get(HEADLINE, {}).get(metric)


def _notes(board: TracksBoard) -> list[str]:
    notes = [
        "A track's column is the mean over its severities 1 to 3. Methods are ranked by the mean "
        "of tracks, clean left out. On a track nobody is told the blur; on clean images a method "
        "that asks for the recipe is.",
        "Fitted on, trained on: this track, its training pairs at the same severity; clean, the "
        "training pairs of the set without a track.",
    ]
    for _, entry in board.rows:
        if entry.told:
            notes.append(
                f"{entry.label}: no rank. No method may be given the blur of a track; the row "
                "shows what knowing it is worth, and a fitted method may still do better"
            )
        if entry.lacking:
            notes.append(f"{entry.label}: no rank without {_few(entry.lacking)}")
    return notes


def _few(labels: list[str]) -> str:
    return ", ".join(labels) if len(labels) <= 3 else f"{len(labels)} of the runs on tracks"


def _record(
    board: TracksBoard, rank: int | None, entry: TracksEntry, folder: Path
) -> dict[str, object]:
    record: dict[str, object] = {
        "dataset": board.dataset,
        "split": board.split,
        "protocol": HEADLINE,
        "rank": rank,
        "method": entry.clean.method.name,
        "parameters": parameters_of(entry.clean),
        "told_on_tracks": entry.told,
        "fitted_on_tracks": fitted_on(entry),
        "trained_on_tracks": trained_on(entry),
        "status": entry.status,
        "result": link_to(entry.path, folder),
    }
    for metric in METRICS:
        record[f"{metric} {CLEAN}"] = _clean(entry, metric)
        for track, values in entry.by_track(metric).items():
            record |= {f"{metric} {track}-{number}": v for number, v in enumerate(values, 1)}
        record |= {f"{metric} {track}": mean for track, mean in entry.means(metric).items()}
        record[f"{metric} mean of tracks"] = entry.mean(metric)
    return record
