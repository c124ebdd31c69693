"""A ranking's tables: methods, scores by lighting, how each was run."""

import os
from pathlib import Path

import numpy as np
import pandas as pd

from dfdbench.blur.tracks import CLEAN
from dfdbench.board.ranking import Entry, ScoreBoard, over_tracks
from dfdbench.datasets.catalog import part_name, released_headings
from dfdbench.metrics.intervals import INTERVAL_GROUPS, interval_name
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import metrics_of, title_of
from dfdbench.results import frame, record, wording
from dfdbench.results.differences import verdict_note
from dfdbench.system.text import TRAININGS
from dfdbench.tables.table import Link, Table


def ranking_table(board: ScoreBoard, folder: Path) -> Table:
    """Return a ranking of single runs or over tracks as a table.

    Parameters
    ----------
    board : ScoreBoard
        From `dfdbench.board.ranking.boards`.
    folder : Path
        The leaderboard's folder; links are relative to it.
    """
    return (standings_table if board.suite == CLEAN else tracks_table)(board, folder)


def standings_table(board: ScoreBoard, folder: Path) -> Table:
    """Return the ranking: by NRMSE, then NMAE, as in the thesis; in metres by AbsRel."""
    metrics = [find_metric(name) for name in metrics_of(board.protocol) if name != board.metric]
    # Rows that nobody could run have no second table to link to their files.
    alone = all(standing.entry.result.method.scored for standing in board.standings)
    scored = f": {record.SCORED}" if alone else ""
    columns = (
        *("", "method", "given", find_metric(board.metric).heading, interval_name(board.groups)),
        *(metric.heading for metric in metrics),
        *("difference from the row above", "seconds per pair"),
    )
    rows = []
    for row, standing in enumerate(board.standings):
        entry = standing.entry
        name = _linked(entry, folder) if scored else entry.label
        first = (standing.place, name, wording.given_to(entry.result))
        score, interval = board.shown(row, board.metric), wording.interval_text(standing.interval)
        others = (board.shown(row, metric.name) for metric in metrics)
        last = (str(standing.above or wording.NOTHING), wording.seconds_text(entry.seconds))
        rows.append((*first, score, interval, *others, *last))
    title = f"{board.result.dataset.heading}, protocol {title_of(board.protocol)}{scored}"
    align, notes = "rllrl" + "r" * len(metrics) + "lr", tuple(_ranking_notes(board))
    records, parts = tuple(records_of(board, folder)), _parts(len(columns), 2)
    return Table(title, columns, tuple(rows), align, notes, records=records, parts=parts)


def _parts(columns: int, last: int) -> tuple[tuple[int, ...], ...]:
    """Return the columns of a ranking in two parts: all but the last few, and the last few."""
    begin = columns - last
    return tuple(range(begin)), (0, 1, *range(begin, columns))


def tracks_table(board: ScoreBoard, folder: Path) -> Table:
    """Return a ranking over tracks: clean, each track's mean over severities, their mean."""
    tracks = pd.DataFrame(tracks_of(board).xs(board.metric, level="metric"))
    own = board.scores[board.scores["metric"] == board.metric]
    on_clean = frame.group_means(own[own["track"] == CLEAN], "row")
    rows = []
    for row, standing in enumerate(board.standings):
        entry, mean = standing.entry, standing.scores[board.metric]
        scores = map(wording.score_text, (on_clean.get(row, np.nan), *tracks.loc[row], mean))
        told = (wording.interval_text(standing.interval), str(standing.above or wording.NOTHING))
        seen = (_seen(entry, fact) for fact in ("fitted_on", "trained_on"))
        rows.append((standing.place, _linked(entry, folder), *scores, *told, *seen))
    dataset = board.result.dataset
    columns = (
        *("", "method", CLEAN, *tracks, "mean of tracks", interval_name(board.groups)),
        *("difference from the row above", "fitted on", "trained on"),
    )
    title = (
        f"{part_name(dataset.name)[0]}, split {dataset.split}, {board.suite}, "
        f"protocol {title_of(board.protocol)}: {find_metric(board.metric).heading}"
    )
    align, notes = "rl" + "r" * (len(columns) - 5) + "lll", tuple(_tracks_notes(board, tracks))
    records, parts = tuple(records_of(board, folder)), _parts(len(columns), 3)
    return Table(title, columns, tuple(rows), align, notes, records=records, parts=parts)


def tracks_of(board: ScoreBoard) -> pd.DataFrame:
    """Return each row's mean over severities, by row and metric, one column per track."""
    means = frame.group_means(board.scores, "row", "metric", "track", "severity")
    return over_tracks(means, board.suite)


def lighting_table(board: ScoreBoard) -> Table:
    """Return each method's means by block, for instance exposure, one row per metric."""
    axis = board.result.dataset.blocks
    means = _by_level(board)
    levels = sorted(means.index.get_level_values("level").unique())
    rows: list[tuple[str, ...]] = []
    records = []
    metrics = [name for name in metrics_of(board.protocol) if name in set(board.scores["metric"])]
    for row, standing in enumerate(board.standings):
        for metric in metrics:
            found = [float(means[row][metric, level]) for level in levels]
            name = standing.entry.label if metric == metrics[0] else ""
            shown = (*map(wording.score_text, found), board.shown(row, metric))
            rows.append((name, find_metric(metric).heading, *shown))
            by_level = {f"{axis} {n}": frame.defined(v) for n, v in zip(levels, found, strict=True)}
            head = {"method": standing.entry.label, "metric": metric}
            records.append({**head, **by_level, "overall": standing.scores[metric]})
    columns = ("method", "", *(f"{axis} {level}" for level in levels), "overall")
    rules = frozenset(range(len(metrics) - 1, len(rows), len(metrics)))
    return Table(f"by {axis}", columns, tuple(rows), "ll", (), rules, tuple(records))


def _by_level(board: ScoreBoard) -> pd.DataFrame:
    axis = board.result.dataset.blocks
    levels = board.scores["coordinates"].map(lambda coordinates: coordinates[axis])
    return board.means(board.scores.assign(level=levels), "metric", "level")


def runs_table(board: ScoreBoard, folder: Path | None = None) -> Table:
    """Return how each method was run; given the leaderboard's folder, link to its file."""
    rows = []
    for entry in (standing.entry for standing in board.standings):
        name = entry.label if folder is None else _linked(entry, folder)
        result, method = entry.result, entry.result.method
        how = (wording.parameters_of(result), wording.training_text(method))
        where = (wording.seconds_text(entry.seconds), wording.machine_of(result))
        rows.append((name, *how, *where, method.paper or wording.NOTHING))
    columns = ("method", "parameters", "training data", "seconds per pair", "machine", "paper")
    return Table("how they were run", columns, tuple(rows), "lllrll", (wording.SECONDS_NOTE,))


def records_of(board: ScoreBoard, folder: Path) -> list[dict[str, object]]:
    """Return the rows of a ranking as data, with unrounded numbers."""
    metric, data = board.metric, board.result.dataset
    by_place = _by_place(board)
    records = []
    for row, standing in enumerate(board.standings):
        entry, above = standing.entry, standing.above
        low, high = standing.interval or (None, None)
        records.append(
            {
                "dataset": data.name if board.suite == CLEAN else part_name(data.name)[0],
                "split": data.split,
                "suite": board.suite,
                "protocol": board.protocol,
                "fingerprint": data.fingerprint,
                "rank": standing.rank,
                "method": entry.label,
                "parameters": wording.parameters_of(entry.result),
                **_knowledge(board, entry),
                **standing.scores,
                f"{metric}_low": low,
                f"{metric}_high": high,
                "interval": interval_name(board.groups),
                f"{metric}_difference": above.mean if above else None,
                f"{metric}_difference_low": above.low if above else None,
                f"{metric}_difference_high": above.high if above else None,
                f"{metric}_difference_p": above.p if above else None,
                **{place: frame.defined(values[row]) for place, values in by_place.items()},
                "seconds": entry.seconds,
                "machine": wording.machine_of(entry.ranked_runs[0]),
                "pairs": "/".join(
                    str(sum(getattr(run.dataset, count) for run in entry.ranked_runs))
                    for count in ("evaluated", "expected")
                ),
                "result": link_to(entry.path, folder),
            }
        )
    return records


def _by_place(board: ScoreBoard) -> dict[str, list[float]]:
    """Return means by metric and lighting, or by metric and track, one value per row."""
    if board.suite == CLEAN:
        axis = board.result.dataset.blocks
        levels = _by_level(board).sort_index()
        places = [f"{name} {axis} {level}" for name, level in levels.index.tolist()]
        return dict(zip(places, levels.to_numpy().tolist(), strict=True))
    runs = board.means(board.scores, "metric", "track", "severity").sort_index()
    tracks = pd.DataFrame(tracks_of(board).stack("track").unstack("row"))
    places = [
        f"{name} {track}" + (f"-{severity}" if severity else "")
        for name, track, severity in runs.index.tolist()
    ]
    places += [f"{name} {track}" for name, track in tracks.index.tolist()]
    values = runs.to_numpy().tolist() + tracks[list(runs.columns)].to_numpy().tolist()
    return dict(zip(places, values, strict=True))


def _knowledge(board: ScoreBoard, entry: Entry) -> dict[str, object]:
    if board.suite == CLEAN:
        method = entry.result.method
        said = {"given": wording.given_to(entry.result), "trained_on": method.trained_on}
        return {**said, "fitted_on": method.fitted_on}
    seen = {fact: _seen(entry, fact) for fact in ("trained_on", "fitted_on")}
    return {"given_blur": entry.given_blur, **seen}


def link_to(path: Path, folder: Path) -> str:
    """Return the link to a file, relative to the leaderboard's folder.

    Examples
    --------
    >>> link_to(Path("runs/mine/result.json"), Path("leaderboard"))
    '../runs/mine/result.json'
    """
    return Path(os.path.relpath(path, folder)).as_posix()


def _linked(entry: Entry, folder: Path) -> str:
    return Link(entry.label, link_to(entry.path, folder))


def _ranking_notes(board: ScoreBoard) -> list[str]:
    notes = [*_interval_notes(board), wording.GIVEN_NOTE]
    trained_on = [standing.entry.result.method.trained_on or "" for standing in board.standings]
    trainings = [part for text in trained_on for part in text.split(TRAININGS)]
    others = {part.partition(",")[0] for part in trainings} - {board.result.dataset.name}
    notes += [f"{h.stem}: {h.title}." for h in released_headings() if h.stem in others]
    for standing in board.standings:
        entry = standing.entry
        if entry.result.method.name == "constant" and (ssim := standing.scores.get("ssim")):
            notes.append(
                f"Compare {find_metric('ssim').title} with {ssim:.2f}, which a constant depth map "
                "already reaches here."
            )
        if not entry.complete or entry.given_blur or standing.scores.get(board.metric) is None:
            notes.append(f"{entry.label}: {entry.unranked(board.protocol)}")
    return notes


def _interval_notes(board: ScoreBoard) -> list[str]:
    if board.groups == 1:
        return ["A single group of scenes: no interval."]
    notes = [
        f"Difference from the row above: how much larger {find_metric(board.metric).title} is, "
        "capture by capture.",
        verdict_note(board.groups),
    ]
    if board.groups >= INTERVAL_GROUPS:
        notes.append(
            "Rows whose intervals overlap are too close to tell: a rank counts only the rows whose "
            "whole interval is lower, and is never behind that of a row further down."
        )
    return notes


def _tracks_notes(board: ScoreBoard, tracks: pd.DataFrame) -> list[str]:
    notes = [
        "A track's column is the mean over its severities. Methods are ranked by the mean of "
        "tracks, clean images left out. On a track no method is given the blur; on clean images "
        "a method that asks for the recipe is.",
        "Fitted on, trained on: this track means its training pairs at the same severity; clean "
        "means the training pairs of the set without a track.",
        *_interval_notes(board),
    ]
    for row, standing in enumerate(board.standings):
        label = standing.entry.label
        if standing.entry.given_blur:
            notes.append(
                f"{label}: no rank. No method may be given the blur of a track; the row shows what "
                "knowing it is worth, and a fitted method may still do better"
            )
        if lacking := [track for track, value in tracks.loc[row].items() if np.isnan(value)]:
            notes.append(f"{label}: no rank without all of {', '.join(map(str, lacking))}")
    return notes


def _seen(entry: Entry, fact: str) -> str:
    told = ((getattr(run.method, fact), run.dataset.name) for run in entry.ranked_runs)
    texts = {_in_short(text, name) for text, name in told if text}
    return "; ".join(sorted(texts)) or wording.NOTHING


def _in_short(text: str, dataset: str) -> str:
    name, _, rest = text.partition(", ")
    if name == dataset:
        return "this track"
    base, track = part_name(name)
    synthetic = {h.stem for h in released_headings() if h.recipe is not None}
    # Words after the split mean that training was not on clean images.
    if base not in synthetic or track or ", " in rest:
        return text
    return CLEAN if base == part_name(dataset)[0] else f"{CLEAN} {base}"
