"""A submission of a method's runs on tracks: one sealed file in the leaderboard's folder."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dfdbench.blur.tracks import CLEAN
from dfdbench.errors import Problem, ResultError
from dfdbench.leaderboard.data_set_problems import data_set_problems
from dfdbench.leaderboard.folder import RESULTS, file_stems
from dfdbench.leaderboard.submission import future_problems, sealed, under_protocol
from dfdbench.results.record import Result
from dfdbench.results.record_file import contradictions, read_json, seal_of
from dfdbench.results.told import knew_blur
from dfdbench.results.tracks_record import TracksRecord, results_of, tracks_record
from dfdbench.results.wording import method_label
from dfdbench.system.files import write_whole
from dfdbench.system.record import problems_of

#: Where they lie, beside the protocols' folders of the same data set and split.
TRACKS_FOLDER = "tracks"
#: The protocol that tracks are ranked by.
HEADLINE = "valid"
_FIX = "write it with `dfdbench tracks ... --submit`"


def tracks_label(results: Mapping[str, Result]) -> str:
    """Return the method with its parameters, and whether it was given a blur on a track."""
    label = method_label(results[CLEAN].method)
    if not any(map(knew_blur, results.values())):
        return label
    own = results[CLEAN].method.parameters.get("recipe") is not None
    return f"{label}, given {'a' if own else 'the'} blur"


def _stems(results: Mapping[str, Result]) -> tuple[str, str]:
    # Files end as the folders of `dfdbench tracks --told` do.
    given = ", told" if any(map(knew_blur, results.values())) else ""
    clean = results[CLEAN]
    return file_stems(method_label(clean.method) + given, clean.dataset.fingerprint)


def is_tracks_file(path: Path) -> bool:
    """Return whether a file of the leaderboard holds runs on tracks, by what is in it.

    Raises
    ------
    ResultError
        Where it cannot be read.
    """
    content = read_json(path)
    return isinstance(content, dict) and "runs" in content


def submit_tracks(
    results: Mapping[str, Result], folder: Path, submitted: datetime | None = None
) -> Path:
    """Write a method's runs on tracks as the leaderboard takes them, one sealed file; return it.

    Parameters
    ----------
    results : mapping of str to Result
        The runs by ``clean`` and ``TRACK-SEVERITY``, all of one method on one split.
    folder : Path
        The leaderboard's folder.
    submitted : datetime, optional
        When; default: now.

    Raises
    ------
    ResultError
        Where a run is not one of a released data set's split, they are not of one method, or a
        file with more complete runs is there. Nothing is written then.
    """
    narrowed = {label: under_protocol(result, HEADLINE) for label, result in results.items()}
    problems = [
        problem
        for label, result in narrowed.items()
        for problem in data_set_problems(result, folder, f"this run on {label}")
    ]
    problems += _different_runs(narrowed)
    if problems:
        raise ResultError.of(problems)
    record = tracks_record(narrowed, HEADLINE)
    path = _free_place(results_of(record), folder)
    if path.exists():
        _require_no_less(results_of(read_tracks(path)), narrowed, path)
    write_whole(path, _as_text(sealed(record, submitted or datetime.now(UTC))))
    return path


def _different_runs(results: Mapping[str, Result]) -> Iterator[Problem]:
    def facts(result: Result) -> dict[str, Any]:
        method, dataset = result.method, result.dataset
        return {
            "method": method.name,
            "entry": method.entry,
            "parameters": method.parameters,
            "source": method.source_sha256,
            "weights": method.weights_sha256,
            "files": method.files_sha256,
            "split": dataset.split,
            "manifest": dataset.manifest_sha256,
            "seed": result.seed,
        }

    clean = facts(results[CLEAN])
    for label, result in results.items():
        for name, value in facts(result).items():
            if value != clean[name]:
                yield Problem(
                    "the runs are not of one method on one split",
                    where=f"this run on {label}: {name}",
                    expected=f"{clean[name]}, as on {CLEAN} images",
                    got=str(value),
                )


def _require_no_less(
    there: Mapping[str, Result], results: Mapping[str, Result], path: Path
) -> None:
    whole = [label for label, result in there.items() if result.complete]
    lacking = [label for label in whole if label not in results or not results[label].complete]
    if lacking:
        raise ResultError(
            "runs on fewer tracks do not take the place of runs on more",
            where=str(path),
            expected=f"complete runs on {', '.join(whole)}",
            got=f"none on {', '.join(lacking)}",
            fix="run the rest: the same command without --track goes on where it stopped",
        )


def _free_place(results: Mapping[str, Result], folder: Path) -> Path:
    stem, longer = _stems(results)
    path = _folder_of(results, folder) / f"{stem}.json"
    if path.exists():
        there = results_of(read_tracks(path))
        if _stems(there)[1] != longer:
            return path.with_stem(longer)
    return path


def _folder_of(results: Mapping[str, Result], folder: Path) -> Path:
    dataset = results[CLEAN].dataset
    return folder / RESULTS / f"{dataset.name}-{dataset.split}" / TRACKS_FOLDER


def _as_text(content: dict[str, Any]) -> str:
    """Return JSON with a line for each field and for each run: short, and fit to be compared."""

    def lines(parts: Mapping[str, Any], indent: str) -> str:
        return ",\n".join(
            f"{indent}{json.dumps(name)}: {_one_line(value)}" for name, value in parts.items()
        )

    shared = lines({name: value for name, value in content.items() if name != "runs"}, " ")
    return f'{{\n{shared},\n "runs": {{\n{lines(content["runs"], "  ")}\n }}\n}}\n'


def _one_line(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def read_tracks(path: Path) -> TracksRecord:
    """Read a file of runs on tracks; its fields are checked, not what they say together.

    Raises
    ------
    ResultError
        Where it cannot be read, or is not such a file.
    """
    try:
        record = TracksRecord.model_validate(read_json(path), strict=True)
        results_of(record)
    except ValidationError as error:
        what = "wrong value in the runs on tracks"
        raise ResultError.of(problems_of(error, what, file=path, fix=_FIX)) from error
    return record


def load_tracks(path: Path, folder: Path) -> dict[str, Result]:
    """Read one file of runs on tracks and hold it to its data sets, protocol and place.

    Returns
    -------
    dict of str to Result
        Each run, by ``clean`` and ``TRACK-SEVERITY``.

    Raises
    ------
    ResultError
        With every problem that was found.
    """
    record = read_tracks(path)
    results = results_of(record)
    problems = [*runs_problems(results, path, folder), *_misplaced(record, results, path, folder)]
    if problems:
        raise ResultError.of(problems)
    return results


def runs_problems(results: Mapping[str, Result], path: Path, folder: Path) -> list[Problem]:
    """Return in what runs on tracks contradict themselves, or the released data and protocols."""
    return [
        problem
        for label, result in results.items()
        for problem in (
            *contradictions(result, f"{path}: {label}"),
            *data_set_problems(result, folder, f"{path}: {label}"),
        )
    ]


def _misplaced(
    record: TracksRecord, results: Mapping[str, Result], path: Path, folder: Path
) -> Iterator[Problem]:
    stems = _stems(results)
    place = _folder_of(results, folder)
    if record.submission is None:
        yield Problem("not a submission", where=str(path), expected="a sealed file", fix=_FIX)
    elif record.submission.seal != seal_of(read_json(path)):
        yield Problem(
            "the file was edited after it was sealed",
            where=f"{path}: submission.seal",
            expected="the SHA-256 of the file's content",
            got=record.submission.seal,
            fix=_FIX,
        )
    yield from future_problems(record.submission, str(path))
    if results[CLEAN].protocol_names != (HEADLINE,):
        yield Problem(
            "tracks are ranked by another protocol",
            where=f"{path}: protocol",
            expected=HEADLINE,
            got=", ".join(results[CLEAN].protocol_names),
        )
    if path.parent != place:
        yield Problem(
            "result in the wrong folder", where=str(path), expected=str(place), got=str(path.parent)
        )
    elif path.stem not in stems:
        yield Problem(
            "the file's name is not its method's",
            where=str(path),
            expected=f"{stems[0]}.json",
            got=path.name,
            fix=_FIX,
        )
