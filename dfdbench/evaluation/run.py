"""Run a method over a split: predict once a pair, score under every protocol, keep it all."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dfdbench
from dfdbench.audit.trained_on import coverage_warnings
from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.store import Store
from dfdbench.errors import ResultError, StoreError, reason_of
from dfdbench.evaluation.pair import (
    PRINTED,
    TURNED,
    Evaluated,
    PairEvaluator,
    RemoteEvaluator,
    blank_record,
)
from dfdbench.methods.method import Method
from dfdbench.metrics.protocol import PROTOCOLS
from dfdbench.results.environment import describe_environment
from dfdbench.results.folder import (
    add_to_journal,
    keep_prediction,
    keep_store_place,
    open_run_folder,
    read_journal,
)
from dfdbench.results.record import DatasetRecord, MethodRecord, PairResult, Result, average
from dfdbench.results.record_file import RESULT, save_result
from dfdbench.system.location import as_location
from dfdbench.system.lock import hold
from dfdbench.system.parallel import Pool

_BATCH = 256  # pairs whose depth maps are in memory together when many run at once


@dataclass(frozen=True)
class Run:
    """What `run_method` did.

    Parameters
    ----------
    result : Result
        The scores.
    folder : Path
        Where ``result.json`` and ``predictions.zarr`` lie.
    reused : int
        Pairs taken over from an earlier call that was stopped or limited.
    set_aside : Path or None
        Where an earlier run of another kind in the same folder was moved.
    """

    result: Result
    folder: Path
    reused: int
    set_aside: Path | None


def run_method(
    store: Store,
    method: Method,
    split: str,
    folder: Path,
    limit: int | None = None,
    keep_predictions: bool = True,
    fresh: bool = False,
    seed: int = 0,
    pool: Pool | None = None,
    on_pair: Callable[[int, int], None] | None = None,
) -> Run:
    """Evaluate a method on a split; go on where an earlier call was stopped.

    Parameters
    ----------
    store : Store
        The data set.
    method : Method
        From `load_for`.
    split : str
        Which pairs.
    folder : Path
        Where result and predictions go.
    limit : int, optional
        Evaluate only that many pairs; the run is then incomplete and has no average.
    keep_predictions : bool
        Write the depth maps beside the result; figures need them.
    fresh : bool
        Evaluate all pairs anew.
    seed : int
        Set in `random` and `numpy.random` before each pair; kept in the result.
    pool : Pool, optional
        Where pairs are evaluated several at once, in other processes; by default one after the
        other in this one, which alone gives times that can be compared.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).

    Raises
    ------
    StoreError
        Where the store holds no pair of the split.
    ResultError
        Where the folder cannot be written.
    """
    expected = store.manifest.pairs(split)
    available = store.pairs(split)
    if not available:
        raise StoreError(
            f"the store holds no pair of split {split}",
            where=str(store.path),
            fix=f"build {store.manifest.short} with the scenes of that split",
        )
    chosen = available[:limit]
    identity = _identity(store, method, split, keep_predictions, seed)
    taken = ResultError(
        "another run is writing this folder",
        where=str(folder),
        fix="wait for it, or choose another with --out DIR",
    )
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with hold(as_location(folder.with_name(f".{folder.name}.lock")), taken):
            set_aside = open_run_folder(folder, identity, fresh)
            keep_store_place(folder, store.path)
            finished = read_journal(folder)
            reused = sum(pair.id in finished for pair in chosen)
            to_do = [pair for pair in chosen if pair.id not in finished]
            done = reused

            def note(pair: Pair, evaluated: Evaluated) -> None:
                nonlocal done
                record, depth = evaluated
                if depth is not None and keep_predictions:
                    keep_prediction(folder, store.manifest, pair, depth)
                finished[pair.id] = record
                add_to_journal(folder, record)
                done += 1
                if on_pair:
                    on_pair(done, len(chosen))

            if pool is None:
                evaluate = PairEvaluator(store, method, seed)
                for pair in to_do:
                    note(pair, evaluate(pair))
            else:
                remote = RemoteEvaluator.of(store, method, seed)
                for start in range(0, len(to_do), _BATCH):
                    pool.map(remote, to_do[start : start + _BATCH], note)
            wanted = {pair.id for pair in chosen}
            present = {pair.id for pair in available}
            pairs = [
                finished[pair.id]
                if pair.id in wanted
                else blank_record(pair, "not-run" if pair.id in present else "missing")
                for pair in expected
            ]
            result = _result(store, method, split, pairs, seed)
            save_result(result, folder / RESULT)
    except OSError as error:
        raise ResultError(
            "cannot write the run",
            where=str(folder),
            got=reason_of(error),
            fix="make room or choose another place with --out DIR; "
            "the same command goes on where it stopped",
        ) from error
    return Run(result, folder, reused, set_aside)


def _identity(
    store: Store, method: Method, split: str, keep_predictions: bool, seed: int
) -> dict[str, Any]:
    # What must be the same for pairs of an earlier call to be taken over.
    identity = {
        "dfdbench": dfdbench.__version__,
        "fingerprint": store.fingerprint,
        "split": split,
        "entry": method.entry,
        "source_sha256": method.source_sha256,
        "parameters": method.parameters,
        "weights_sha256": method.weights_sha256,
        "files_sha256": method.files_sha256,
        "protocols": [protocol.as_dict() for protocol in PROTOCOLS.values()],
        "network_crop": store.manifest.network_crop,
        "keep_predictions": keep_predictions,
        "seed": seed,
    }
    return dict(json.loads(json.dumps(identity)))


def _result(store: Store, method: Method, split: str, pairs: list[PairResult], seed: int) -> Result:
    manifest = store.manifest
    evaluated = [pair for pair in pairs if pair.status == "ok"]
    complete = len(evaluated) == len(pairs)
    trained_on = method.trained_on
    if trained_on is None and "training_mean" in method.uses:
        trained_on = f"{manifest.stem}, split train"
    warnings = []
    printed = _warned(pairs, PRINTED)
    if printed:
        warnings.append(f"the method printed to standard output on {printed} pairs")
    turned = _warned(evaluated, TURNED)
    # A flat board tells no direction: half the pairs of a set that has some are enough.
    if turned and 2 * turned >= len(evaluated):
        warnings.append(
            f"{TURNED} on {turned} of {len(evaluated)} pairs: {manifest.stem} wants brighter for "
            f"{manifest.depth.direction}"
        )
    together = sum(not pair.timed_alone for pair in evaluated)
    if together:
        warnings.append(f"{together} pairs were run several at once: times are not comparable")
    warnings += method.warnings
    warnings += coverage_warnings(method.trained_on, store, split)
    return Result(
        schema_version=1,
        dataset=DatasetRecord(
            name=manifest.stem,
            short=manifest.short,
            manifest_sha256=manifest.sha256,
            fingerprint=store.fingerprint,
            split=split,
            expected=len(pairs),
            evaluated=len(evaluated),
            recipe=store.attributes["recipe"],
            degradation=store.attributes["degradation"],
            options=store.attributes["options"],
            axes=list(manifest.axes),
            blocks=manifest.table.blocks,
            rows=manifest.table.rows,
        ),
        protocols=[protocol.as_dict() for protocol in PROTOCOLS.values()],
        method=MethodRecord(
            name=method.name,
            entry=without_folder(method.entry),
            source_sha256=method.source_sha256,
            parameters={name: _shared(value) for name, value in method.parameters.items()},
            uses=list(method.uses),
            trained_on=trained_on,
            weights_sha256=method.weights_sha256,
            files_sha256=method.files_sha256,
            paper=method.paper,
        ),
        environment=describe_environment(),
        seed=seed,
        pairs=pairs,
        averages=average(evaluated, list(PROTOCOLS)) if complete else None,
        warnings=warnings,
    )


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
