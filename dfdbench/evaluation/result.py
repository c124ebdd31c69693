"""The result of a run: what was run on what, the pairs' scores, their averages, warnings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.evaluation.pair import DIFFERS, PRINTED, TURNED
from dfdbench.evaluation.plan import RunPlan, protocols_on
from dfdbench.methods.calling import UNIT_LEVELS
from dfdbench.methods.method import Method
from dfdbench.results.environment import describe_environment
from dfdbench.results.record import (
    DatasetRecord,
    Environment,
    MethodRecord,
    PairResult,
    Result,
    average,
)
from dfdbench.tables.wording import counted, listed

#: Of many pairs, so many are named.
_NAMED = 10


def result_of(
    plan: RunPlan,
    pairs: list[PairResult],
    environments: Sequence[Environment] = (),
    warnings: Sequence[str] = (),
) -> Result:
    """Return a run's result.

    Parameters
    ----------
    plan : RunPlan
        What was run on what.
    pairs : list of PairResult
        A record for each pair of the split.
    environments : sequence of Environment
        Where the pairs were run, as their `machine` counts them; by default here.
    warnings : sequence of str
        What is said after the warnings that follow from the records.
    """
    said = [*plan.method.warnings, *warnings]
    method, seed = _method_record(plan), plan.options.seed
    return compose(plan.store, plan.split, method, pairs, seed, said, environments)


def compose(
    store: Dataset,
    split: str,
    method: MethodRecord,
    pairs: list[PairResult],
    seed: int = 0,
    warnings: Sequence[str] = (),
    environments: Sequence[Environment] = (),
) -> Result:
    """Return the result of a split's pairs.

    Parameters
    ----------
    store : Dataset
        The data set.
    split : str
        Which pairs of it.
    method : MethodRecord
        Where the depth maps come from.
    pairs : list of PairResult
        A record for each pair of the split.
    seed : int
        Of the run.
    warnings : sequence of str
        What is said after the warnings that follow from the records.
    environments : sequence of Environment
        As for `result_of`.
    """
    first, *others = environments or [describe_environment()]
    evaluated = [pair for pair in pairs if pair.status == "ok"]
    protocols = protocols_on(store)
    labels = [protocol.label for protocol in protocols]
    return Result(
        schema_version=1,
        dataset=_dataset_record(store, split, len(pairs), len(evaluated)),
        protocols=[protocol.as_dict() for protocol in protocols],
        method=method,
        environment=first,
        other_environments=others,
        seed=seed,
        pairs=pairs,
        averages=average(evaluated, labels) if len(evaluated) == len(pairs) else None,
        warnings=[
            *_warnings(store.manifest, pairs, evaluated),
            *_of_machines([first, *others], evaluated),
            *warnings,
        ],
    )


def _dataset_record(store: Dataset, split: str, expected: int, evaluated: int) -> DatasetRecord:
    manifest = store.manifest
    return DatasetRecord(
        name=manifest.stem,
        short=manifest.short,
        manifest_sha256=manifest.sha256,
        fingerprint=store.fingerprint,
        split=split,
        expected=expected,
        evaluated=evaluated,
        recipe=store.attributes["recipe"],
        degradation=store.attributes["degradation"],
        options=store.attributes["options"],
        axes=list(manifest.axes),
        blocks=manifest.table.blocks,
        rows=manifest.table.rows,
        simulated=manifest.simulated,
    )


def _method_record(plan: RunPlan) -> MethodRecord:
    method = plan.method
    return MethodRecord(
        name=method.name,
        entry=without_folder(method.entry),
        source_sha256=method.source_sha256,
        parameters={name: _shared(value) for name, value in method.parameters.items()},
        uses=list(method.uses),
        trained_on=trained_on_of(method, plan.store.manifest),
        weights_sha256=method.weights_sha256,
        files_sha256=method.files_sha256,
        fitted_on=plan.fit.fitted_on if plan.fit else None,
        fit_seconds=plan.fit.seconds if plan.fit else None,
        paper=method.paper,
    )


def trained_on_of(method: Method, manifest: Manifest) -> str | None:
    """Return what a result says that a method was trained on: its own word, or the mean's split."""
    if method.trained_on is None and "training_mean" in method.uses:
        return f"{manifest.stem}, split train"
    return method.trained_on


def _warnings(
    manifest: Manifest, pairs: list[PairResult], evaluated: list[PairResult]
) -> list[str]:
    warnings = []
    missing = [pair.id for pair in pairs if pair.status == "missing"]
    if missing:
        warnings.append(
            f"the store lacks {len(missing)} of {len(pairs)} pairs of the split, and there is no "
            f"average: {listed(missing, _NAMED)}"
        )
    printed = _warned(pairs, PRINTED)
    if printed:
        warnings.append(f"the method printed to standard output on {counted(printed, 'pair')}")
    for pair in evaluated:
        warnings += [
            f"{text} ({pair.id}): the scores cannot be reproduced; does it need a seed?"
            for text in pair.warnings
            if text.startswith(DIFFERS)
        ]
    turned = _warned(evaluated, TURNED)
    # A flat board tells no direction: half the pairs of a set that has some are enough.
    if turned and 2 * turned >= len(evaluated):
        warnings.append(
            f"{TURNED} on {turned} of {len(evaluated)} pairs: {manifest.stem} wants brighter for "
            f"{manifest.depth.direction}"
        )
    if evaluated and _warned(evaluated, UNIT_LEVELS) == len(evaluated):
        warnings.append(f"{UNIT_LEVELS}: multiply the depth by 255?")
    together = sum(not pair.timed_alone for pair in evaluated)
    if together:
        pairs_together = counted(together, "pair")
        warnings.append(f"{pairs_together} run several at once: times are not comparable")
    return warnings


def _of_machines(environments: Sequence[Environment], evaluated: list[PairResult]) -> list[str]:
    there = [environments[machine] for machine in {pair.machine for pair in evaluated}]
    machines = {(each.platform, each.cpu, each.cpu_count, each.gpu) for each in there}
    if len(machines) < 2:
        return []
    return [f"the pairs were run on {len(machines)} machines: times are not comparable"]


def _warned(pairs: list[PairResult], begins: str) -> int:
    return sum(any(text.startswith(begins) for text in pair.warnings) for pair in pairs)


def _shared(value: Any) -> Any:
    # As for entries: of a file, its name.
    if isinstance(value, list):
        return [_shared(part) for part in value]
    if isinstance(value, dict):
        return {name: _shared(part) for name, part in value.items()}
    is_file = isinstance(value, str) and Path(value).is_absolute()
    return Path(value).name if is_file else value


def without_folder(entry: str) -> str:
    """Return a method's entry as results show it: an absolute path's file name only.

    Where a file lies on one machine is no business of those who read the result.

    Examples
    --------
    >>> without_folder("/home/me/mine.py:predict"), without_folder("mine.py:predict")
    ('mine.py:predict', 'mine.py:predict')
    """
    place, _, attribute = entry.rpartition(":")
    return f"{Path(place).name}:{attribute}" if Path(place).is_absolute() else entry
