"""Whether a submitted result is on released data, whole and under released protocols."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from dfdbench.blur.recipe import RECIPES
from dfdbench.datasets.catalog import released_manifests
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.datasets.tracked import part_name, with_track
from dfdbench.errors import DfdbenchError, Problem, unknown_name
from dfdbench.leaderboard.folder import UNDEFINED, known_fingerprints, known_undefined
from dfdbench.leaderboard.text_problems import text_problems
from dfdbench.leaderboard.training_problems import training_problems
from dfdbench.metrics.protocol import RELEASED, label_of
from dfdbench.results.record import Result
from dfdbench.tables.wording import counted, listed


def data_set_problems(result: Result, folder: Path, where: str) -> list[Problem]:
    """Return in what a result differs from the released data set and protocols it names.

    Text that cannot be shown beside other results is a problem as well.
    """
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
    return [
        *_other_facts(result, manifest, where),
        *_other_data(result, manifest, folder, where),
        *_other_recipe(result, where),
        *_other_pairs(result, expected, where),
        *_unmeasured(result, where),
        *_other_protocols(result, where),
        *_left_out(result, folder, where),
        *text_problems(result, where),
        *training_problems(
            result.method.trained_on,
            result.method.weights_sha256,
            dataset.name,
            dataset.split,
            where,
        ),
    ]


def _other_data(result: Result, manifest: Manifest, folder: Path, where: str) -> Iterator[Problem]:
    dataset = result.dataset
    if dataset.manifest_sha256 != manifest.sha256:
        yield Problem(
            f"hash of another manifest than {dataset.name}",
            where=f"{where}: dataset",
            expected=manifest.sha256,
            got=dataset.manifest_sha256,
        )
    known = known_fingerprints(folder).get(dataset.name, [])
    # Built with another recipe it is a board of its own; a track can be built one way only.
    told = "" if manifest.on_track else manifest.recipe or ""
    if manifest.on_track and dataset.recipe != {"name": "", "parameters": {}}:
        yield Problem(
            "a track tells no blur recipe",
            where=f"{where}: dataset.recipe",
            expected='name "", no parameters',
            got=str(dataset.recipe),
        )
    elif dataset.recipe["name"] != told and dataset.fingerprint in known:
        yield Problem(
            f"another blur recipe than {dataset.name} was made with, of which these data are",
            where=f"{where}: dataset.recipe",
            expected=told or "none",
            got=str(dataset.recipe["name"]),
        )
    elif known and dataset.recipe["name"] == told and dataset.fingerprint not in known:
        yield Problem(
            f"fingerprint of other data than {dataset.name}",
            where=f"{where}: dataset",
            expected=" or ".join(known),
            got=dataset.fingerprint,
            fix=f"dfdbench build {dataset.short}",
        )


def _other_recipe(result: Result, where: str) -> Iterator[Problem]:
    recipe = result.dataset.recipe
    name = recipe["name"]
    known: dict[str, dict[str, Any]] = {"": {}} | {
        name: recipe.as_dict() for name, recipe in RECIPES.items()
    }
    if name in known and recipe != (expected := {"name": name, "parameters": known[name]}):
        yield Problem(
            f"not the blur recipe {name}" if name else "a blur recipe without a name",
            where=f"{where}: dataset.recipe",
            expected=str(expected),
            got=str(recipe),
        )


def _other_pairs(result: Result, expected: Mapping[str, Pair], where: str) -> Iterator[Problem]:
    dataset = result.dataset
    found = {pair.id: pair for pair in result.pairs}
    for what, names in (
        ("missing from the split", expected.keys() - found.keys()),
        ("too many for the split", found.keys() - expected.keys()),
    ):
        if names:
            count = counted(len(names), "pair")
            whole = f"{counted(len(expected), 'pair')} of {dataset.name}, split {dataset.split}"
            yield Problem(
                f"{count} {what}",
                where=f"{where}: pairs",
                expected=whole,
                got=listed(sorted(names), most=3),
            )
    for name, pair in found.items():
        there = expected.get(name)
        if there and (pair.scene, pair.coordinates) != (there.scene, there.at):
            yield Problem("pair's coordinates are not those of its name", where=f"{where}: {name}")


def _unmeasured(result: Result, where: str) -> Iterator[Problem]:
    # Seconds are averaged over those that are there: a method must not choose which.
    for pair in result.pairs:
        there = {
            "prediction_sha256": pair.prediction_sha256 is not None,
            "seconds": pair.seconds is not None,
            "scores": bool(pair.scores),
        }
        if result.method.scored:
            del there["seconds"]
        evaluated = pair.status == "ok"
        wrong = ", ".join(field for field, found in there.items() if found is not evaluated)
        if wrong:
            yield Problem(
                "what was measured is lacking" if evaluated else "nothing can have been measured",
                where=f"{where}: {pair.id}",
                expected=f"{wrong}, for its status is ok" if evaluated else f"no {wrong}",
                got=f"no {wrong}" if evaluated else f"{wrong}, and status {pair.status}",
            )
        if evaluated and pair.error is not None:
            yield Problem(
                "an error of a pair that was evaluated",
                where=f"{where}: {pair.id}",
                expected="no error, for its status is ok",
                got=ascii(pair.error)[:80],
            )


def _other_protocols(result: Result, where: str) -> Iterator[Problem]:
    for protocol in result.protocols:
        released = RELEASED.get(label_of(protocol))
        if released is None or _as_json(released.as_dict()) != _as_json(protocol):
            yield Problem(
                "not a released protocol",
                where=f"{where}: protocols",
                expected=str(released.as_dict()) if released else ", ".join(RELEASED),
                got=str(protocol),
            )


def _as_json(protocol: Mapping[str, Any]) -> str:
    # Python takes true for 1.
    return json.dumps(protocol, sort_keys=True)


def _released(name: str) -> Manifest:
    # By its full name alone: another name or a file of one's own would make a board of its own.
    known = {manifest.stem: manifest for manifest in released_manifests()}
    base, label = part_name(name)
    if base not in known:
        raise unknown_name("data set", name, known)
    return with_track(known[base], label) if label else known[base]


def _other_facts(result: Result, manifest: Manifest, where: str) -> Iterator[Problem]:
    facts: dict[str, Any] = {
        "short": manifest.short,
        "degradation": manifest.degradation,
        "axes": list(manifest.axes),
        "blocks": manifest.table.blocks,
        "rows": manifest.table.rows,
        "simulated": manifest.simulated,
    }
    if manifest.capture is None:
        # Only a rig leaves a choice: which lens steps make a pair.
        facts["options"] = {}
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
            undefined = {metric for metric, value in scores.items() if value is None}
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
