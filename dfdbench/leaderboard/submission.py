"""A submission: one run under one protocol, sealed, in the leaderboard's folder."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from dfdbench.datasets.catalog import released_manifests
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import DfdbenchError, Problem, ResultError, unknown_name
from dfdbench.leaderboard.folder import (
    UNDEFINED,
    file_stems,
    known_fingerprints,
    known_undefined,
    place_of,
)
from dfdbench.metrics.protocol import METRICS, RELEASED, label_of
from dfdbench.results.record import (
    MethodRecord,
    Result,
    Submission,
    examine_result,
    load_result,
    seal_of,
)
from dfdbench.system.files import write_whole

TIME_FORMAT = "%Y-%m-%dT%H:%M:%SZ"


def method_label(method: MethodRecord) -> str:
    """Return a method's name with the parameters that were set.

    Examples
    --------
    >>> record = MethodRecord(
    ...     name="local", entry="m:Local", source_sha256=None, parameters={"window": 9}, uses=[],
    ...     trained_on=None, paper=None)
    >>> method_label(record)
    'local (window=9)'
    """
    settings = ", ".join(f"{name}={_shown(value)}" for name, value in method.parameters.items())
    return f"{method.name} ({settings})" if settings else method.name


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
    when = (submitted or datetime.now(UTC)).strftime(TIME_FORMAT)
    for narrowed, path in zip(parts, places, strict=True):
        unsealed = Submission(submitted=when, seal="0" * 64)
        content = json.loads(narrowed.model_copy(update={"submission": unsealed}).model_dump_json())
        content["submission"]["seal"] = seal_of(content)
        write_whole(path, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return places


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
    if problems:
        raise ResultError.of(problems)
    return result


def data_set_problems(result: Result, folder: Path, where: str) -> list[Problem]:
    """Return in what a result differs from the released data set and protocols it names."""
    dataset = result.dataset
    try:
        manifest = _released(dataset.name)
        expected = {pair.id: pair for pair in manifest.pairs(dataset.split)}
    except DfdbenchError as error:
        return [
            Problem(
                problem.what,
                where=where,
                expected=problem.expected,
                got=problem.got,
                fix=problem.fix,
            )
            for problem in error.problems
        ]
    problems = list(_other_facts(result, manifest, where))
    if dataset.manifest_sha256 != manifest.sha256:
        problems.append(
            Problem(
                f"hash of another manifest than {dataset.name}",
                where=f"{where}: dataset",
                expected=manifest.sha256,
                got=dataset.manifest_sha256,
            )
        )
    known = known_fingerprints(folder).get(dataset.name)
    if known and dataset.recipe["name"] == manifest.recipe and dataset.fingerprint not in known:
        problems.append(
            Problem(
                f"fingerprint of other data than {dataset.name}",
                where=f"{where}: dataset",
                expected=" or ".join(known),
                got=dataset.fingerprint,
                fix=f"dfdbench build {dataset.short}",
            )
        )
    found = {pair.id: pair for pair in result.pairs}
    for what, names in (
        ("missing from the split", expected.keys() - found.keys()),
        ("too many for the split", found.keys() - expected.keys()),
    ):
        if names:
            count = f"{len(names)} pair{'s' if len(names) > 1 else ''}"
            whole = f"{len(expected)} pairs of {dataset.name}, split {dataset.split}"
            named = ", ".join(sorted(names)[:3]) + (", ..." if len(names) > 3 else "")
            problems.append(
                Problem(f"{count} {what}", where=f"{where}: pairs", expected=whole, got=named)
            )
    problems += [
        Problem("pair's coordinates are not those of its name", where=f"{where}: {name}")
        for name, pair in found.items()
        if name in expected
        and (pair.scene, pair.coordinates) != (expected[name].scene, expected[name].at)
    ]
    for protocol in result.protocols:
        released = RELEASED.get(label_of(protocol))
        if released is None or released.as_dict() != protocol:
            problems.append(
                Problem(
                    "not a released protocol",
                    where=f"{where}: protocols",
                    expected=str(released.as_dict()) if released else ", ".join(RELEASED),
                    got=str(protocol),
                )
            )
    return problems + _left_out(result, folder, where)


def _released(name: str) -> Manifest:
    # By its full name alone: another name or a file of one's own would make a board of its own.
    known = {manifest.stem: manifest for manifest in released_manifests()}
    if name not in known:
        raise unknown_name("data set", name, known)
    return known[name]


def _other_facts(result: Result, manifest: Manifest, where: str) -> Iterator[Problem]:
    facts = {
        "short": manifest.short,
        "degradation": manifest.degradation,
        "axes": list(manifest.axes),
        "blocks": manifest.table.blocks,
        "rows": manifest.table.rows,
    }
    for field, value in facts.items():
        got = getattr(result.dataset, field)
        if got != value:
            what = f"not what the manifest of {manifest.stem} says"
            yield Problem(
                what, where=f"{where}: dataset.{field}", expected=str(value), got=str(got)
            )


def _left_out(result: Result, folder: Path, where: str) -> list[Problem]:
    # A method must not choose by what it gives which pairs are averaged.
    problems = []
    for protocol in result.protocol_names:
        known = known_undefined(folder, result.dataset.fingerprint, protocol)
        for pair in result.pairs:
            if pair.status != "ok" or protocol not in pair.scores:
                continue
            scores = pair.scores[protocol]
            undefined = {metric for metric in METRICS if getattr(scores, metric) is None}
            if undefined != (expected := known.get(pair.id, set())):
                problems.append(
                    Problem(
                        what="scores are undefined elsewhere than the data leave them undefined",
                        where=f"{where}: {pair.id}, {protocol}",
                        expected=", ".join(sorted(expected)) or "every score is a number",
                        got=", ".join(sorted(undefined)) or "every score is a number",
                        fix="run the method again; undefined ground truth is listed in "
                        f"{folder / UNDEFINED}",
                    )
                )
    return problems


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


def _shown(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
