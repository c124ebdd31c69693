"""A submission: one run under one protocol, sealed, in the leaderboard's folder."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from dfdbench.errors import Problem, ResultError
from dfdbench.leaderboard.data_set_problems import data_set_problems
from dfdbench.leaderboard.folder import file_stems, place_of
from dfdbench.metrics.protocol import label_of
from dfdbench.results.record import Result, Submission
from dfdbench.results.record_file import examine_result, load_result, seal_of
from dfdbench.results.wording import method_label
from dfdbench.system.files import write_whole
from dfdbench.system.record import Record

TIME_FORMAT = "%Y-%m-%dT%H:%M:%SZ"
#: How far ahead a submitter's clock may be.
_CLOCKS_DIFFER = timedelta(days=1)


def submit(result: Result, folder: Path, submitted: datetime | None = None) -> list[Path]:
    """Write a run as the leaderboard takes it, a sealed file for each protocol; return them.

    A result of the same method, parameters and data set that is there already is replaced, but
    a complete one not by one of a partial run.

    Parameters
    ----------
    result : Result
        The run.
    folder : Path
        The leaderboard's folder.
    submitted : datetime, optional
        When; default: now.

    Raises
    ------
    ResultError
        Where the run is not one of a released data set's split, or is a partial run and a
        complete one is there. Nothing is written then.
    """
    problems = data_set_problems(result, folder, "this run")
    if problems:
        raise ResultError.of(problems)
    parts = [under_protocol(result, protocol) for protocol in result.protocol_names]
    places = [_free_place(part, folder) for part in parts]
    problems = [_partial(result, path) for path in places if not result.complete and _whole(path)]
    if problems:
        raise ResultError.of(problems)
    when = submitted or datetime.now(UTC)
    for narrowed, path in zip(parts, places, strict=True):
        content = sealed(narrowed, when)
        write_whole(path, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return places


def sealed(record: Record, submitted: datetime) -> dict[str, Any]:
    """Return what the file of a record with a field `submission` says, its seal included."""
    unsealed = Submission(submitted=submitted.strftime(TIME_FORMAT), seal="0" * 64)
    content: dict[str, Any] = json.loads(
        record.model_copy(update={"submission": unsealed}).model_dump_json()
    )
    content["submission"]["seal"] = seal_of(content)
    return content


def under_protocol(result: Result, protocol: str) -> Result:
    """Return a result with the scores of one protocol only."""
    pairs = [
        pair.model_copy(
            update={"scores": {name: s for name, s in pair.scores.items() if name == protocol}}
        )
        for pair in result.pairs
    ]
    averages = {protocol: result.averages[protocol]} if result.averages else None
    chosen = [known for known in result.protocols if label_of(known) == protocol]
    return result.model_copy(
        update={"pairs": pairs, "averages": averages, "protocols": chosen, "submission": None}
    )


def load_submission(path: Path, folder: Path) -> Result:
    """Read one file of the leaderboard and hold it to its data set, protocol and place.

    Raises
    ------
    ResultError
        With every problem that was found.
    """
    result, problems = examine_result(path)
    stems = file_stems(method_label(result.method), result.dataset.fingerprint)
    if result.submission is None:
        problems.append(
            Problem(
                "not a submission",
                where=str(path),
                expected="a sealed result of one protocol",
                fix="write it with `dfdbench run ... --submit`",
            )
        )
    elif len(result.protocols) != 1 or path.parent != _place(result, folder):
        problems.append(
            Problem(
                "result in the wrong folder",
                where=str(path),
                expected=str(_place(result, folder)),
                got=str(path.parent),
            )
        )
    elif path.stem not in stems:
        problems.append(
            Problem(
                "the file's name is not its method's",
                where=str(path),
                expected=f"{stems[0]}.json",
                got=path.name,
                fix="write it with `dfdbench run ... --submit`",
            )
        )
    problems += data_set_problems(result, folder, str(path))
    problems += future_problems(result.submission, str(path))
    if problems:
        raise ResultError.of(problems)
    return result


def future_problems(
    submission: Submission | None, where: str, now: datetime | None = None
) -> Iterator[Problem]:
    """Tell where a submission is from the future: it would be the newest for ever.

    Parameters
    ----------
    submission : Submission or None
        What the file says.
    where : str
        The file.
    now : datetime, optional
        Default: the clock's.
    """
    latest = ((now or datetime.now(UTC)) + _CLOCKS_DIFFER).strftime(TIME_FORMAT)
    if submission and submission.submitted > latest:
        yield Problem(
            "submitted in the future",
            where=f"{where}: submission.submitted",
            expected=f"at most {latest}",
            got=submission.submitted,
            fix="set the clock, and submit the run again: `dfdbench run ... --submit`",
        )


def _place(result: Result, folder: Path) -> Path:
    return place_of(result.dataset, next(iter(result.protocol_names), "PROTOCOL"), folder)


def _free_place(result: Result, folder: Path) -> Path:
    stem, longer = file_stems(method_label(result.method), result.dataset.fingerprint)
    path = _place(result, folder) / f"{stem}.json"
    if path.exists():
        there = load_result(path)
        if file_stems(method_label(there.method), there.dataset.fingerprint)[1] != longer:
            return path.with_stem(longer)
    return path


def _whole(path: Path) -> bool:
    return path.exists() and load_result(path).complete


def _partial(result: Result, path: Path) -> Problem:
    dataset = result.dataset
    return Problem(
        "a partial run does not take the place of a complete one",
        where=str(path),
        expected=f"{dataset.expected} pairs",
        got=f"{dataset.evaluated} pairs",
        fix="run the rest: the same command goes on where it stopped",
    )
