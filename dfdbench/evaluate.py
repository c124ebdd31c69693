"""Run a method over a split: predict once a pair, score under every protocol, keep it all."""

from __future__ import annotations

import json
import math
import random
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import filelock
import numpy as np
import zarr
from numpy.typing import NDArray

import dfdbench
from dfdbench.environment import describe_environment
from dfdbench.errors import Problem, ResultError, StoreError
from dfdbench.files import write_whole
from dfdbench.fingerprint import array_digest
from dfdbench.manifest import Pair
from dfdbench.methods import Method, Prediction, call, load_method
from dfdbench.protocol import PROTOCOLS, score
from dfdbench.result import (
    DatasetRecord,
    MethodRecord,
    PairResult,
    PairScores,
    Result,
    average,
    save_result,
)
from dfdbench.store import PairImages, Store
from dfdbench.trained_on import coverage_warnings

_IDENTITY = "run.json"
_JOURNAL = "pairs.jsonl"
PREDICTIONS = "predictions.zarr"
RESULT = "result.json"


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


def load_for(store: Store, name: str, parameters: Mapping[str, Any], seed: int = 0) -> Method:
    """Load a method and hand it the facts of the data set that it asks for.

    A class with a parameter ``recipe`` gets the data set's blur recipe, one with
    ``training_mean`` the mean depth of the training split, one with ``seed`` the run's seed.
    """
    return load_method(
        name,
        parameters,
        {
            "recipe": lambda: store.recipe,
            "training_mean": lambda: training_mean(store),
            "seed": lambda: seed,
        },
    )


def training_mean(store: Store) -> float:
    """Return the mean depth level over the known pixels of the training split's depth maps.

    Raises
    ------
    StoreError
        Where the store holds no training pair.
    """
    total, count = 0, 0
    seen: set[tuple[str, tuple[int, ...]]] = set()
    for pair in store.pairs("train"):
        place = (pair.scene, tuple(pair.at[axis] for axis in store.manifest.depth.axes))
        if place not in seen:
            seen.add(place)
            depth, valid = store.read_depth(pair)
            total += int(depth[valid].astype(np.int64).sum())
            count += int(valid.sum())
    if not count:
        raise StoreError(Problem("the store holds no training depth", str(store.path)))
    return total / count


def run_method(
    store: Store,
    method: Method,
    split: str,
    folder: Path,
    limit: int | None = None,
    keep_predictions: bool = True,
    fresh: bool = False,
    seed: int = 0,
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
            Problem(f"the store holds no pair of split {split}", str(store.path),
                    fix=f"build {store.manifest.short} with the scenes of that split")
        )  # fmt: skip
    chosen = available[:limit]
    identity = _identity(store, method, split, keep_predictions, seed)
    lock = filelock.FileLock(folder.with_name(f".{folder.name}.lock"))
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=0)
        set_aside = _open_folder(folder, identity, fresh)
        finished = _read_journal(folder)
        reused = sum(pair.id in finished for pair in chosen)
        to_do = [pair for pair in chosen if pair.id not in finished]
        for number, pair in enumerate(to_do):
            images = store.read(pair)
            if number == 0 and method.warm_up:
                _seed(seed)
                call(method.warm_up, images.infocus, images.defocus)
            _seed(seed)
            prediction = call(method.predict, images.infocus, images.defocus)
            if prediction.depth is not None and keep_predictions:
                _keep(folder, store, images, prediction.depth)
            record = _record(store, images, prediction)
            finished[pair.id] = record
            with (folder / _JOURNAL).open("a", encoding="utf-8") as journal:
                journal.write(record.model_dump_json() + "\n")
            if on_pair:
                on_pair(reused + number + 1, len(chosen))
        wanted = {pair.id for pair in chosen}
        present = {pair.id for pair in available}
        pairs = [
            finished[pair.id]
            if pair.id in wanted
            else _blank(pair, "not-run" if pair.id in present else "missing")
            for pair in expected
        ]
        result = _result(store, method, split, pairs, seed)
        save_result(result, folder / RESULT)
    except filelock.Timeout as error:
        raise ResultError(
            Problem(
                "another run is writing this folder", str(folder),
                fix="wait for it, or choose another with --out DIR",
            )
        ) from error  # fmt: skip
    except OSError as error:
        raise ResultError(
            Problem(
                "cannot write the run", str(folder), got=error.strerror or str(error),
                fix="make room or choose another place with --out DIR; "
                "the same command goes on where it stopped",
            )
        ) from error  # fmt: skip
    finally:
        lock.release()
    return Run(result, folder, reused, set_aside)


def read_prediction(folder: Path, pair: Pair) -> NDArray[np.float32] | None:
    """Return a depth map that a run kept, shape (y, x), or None where there is none."""
    place = folder / PREDICTIONS / pair.scene
    if not place.exists():
        return None
    array = zarr.open_group(place, mode="r")["depth"]
    assert isinstance(array, zarr.Array)
    axes = array.attrs["axes"]
    assert isinstance(axes, dict)
    index = tuple(axes[axis].index(value) for axis, value in pair.coordinates)
    depth = np.asarray(array[index], np.float32)
    return None if np.isnan(depth).all() else depth


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
        "protocols": [protocol.as_dict() for protocol in PROTOCOLS.values()],
        "network_crop": store.manifest.network_crop,
        "keep_predictions": keep_predictions,
        "seed": seed,
    }
    return dict(json.loads(json.dumps(identity)))


def _open_folder(folder: Path, identity: Mapping[str, Any], fresh: bool) -> Path | None:
    set_aside = None
    if folder.exists() and any(folder.iterdir()):
        if not (folder / _IDENTITY).exists():
            raise ResultError(
                Problem(
                    "the folder holds something else than a run", str(folder),
                    fix="choose another with --out DIR",
                )
            )  # fmt: skip
        before = json.loads((folder / _IDENTITY).read_text(encoding="utf-8"))
        if fresh or before != identity:
            set_aside = folder.with_name(folder.name + ".previous")
            if set_aside.exists():
                shutil.rmtree(set_aside)
            folder.rename(set_aside)
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / _IDENTITY).exists():
        write_whole(folder / _IDENTITY, json.dumps(identity, indent=1) + "\n")
    return set_aside


def _read_journal(folder: Path) -> dict[str, PairResult]:
    # A line cut short by a kill is left out, and so are failed pairs: both are tried again.
    path = folder / _JOURNAL
    finished = {}
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                record = PairResult.model_validate_json(line)
            except ValueError:
                continue
            if record.status == "ok":
                finished[record.id] = record
        whole = "".join(record.model_dump_json() + "\n" for record in finished.values())
        write_whole(path, whole)
    return finished


def _keep(folder: Path, store: Store, images: PairImages, depth: NDArray[np.float32]) -> None:
    axes = store.manifest.axes
    group = zarr.open_group(folder / PREDICTIONS, path=images.pair.scene, mode="a", zarr_format=3)
    if "depth" not in group:
        group.create_array(
            "depth",
            shape=(*(len(values) for values in axes.values()), *depth.shape),
            chunks=(*(1 for _ in axes), *depth.shape),
            dtype="float32",
            fill_value=math.nan,
            dimension_names=(*axes, "y", "x"),
            attributes={"axes": axes},
        )
    array = group["depth"]
    assert isinstance(array, zarr.Array)
    index = tuple(axes[axis].index(value) for axis, value in images.pair.coordinates)
    array[index] = depth


def _record(store: Store, images: PairImages, prediction: Prediction) -> PairResult:
    warnings = []
    if prediction.printed:
        first = prediction.printed.strip().splitlines()[:1]
        warnings.append(f"printed {len(prediction.printed)} characters: {''.join(first)[:80]}")
    blank = _blank(images.pair, "failed")
    if prediction.depth is None:
        return blank.model_copy(update={"error": prediction.error, "warnings": warnings})
    crop = store.manifest.network_crop
    scores = {
        name: score(protocol, images.depth, images.valid, prediction.depth, crop)
        for name, protocol in PROTOCOLS.items()
    }
    return blank.model_copy(
        update={
            "status": "ok",
            "seconds": prediction.seconds,
            "prediction_sha256": array_digest("depth", ("y", "x"), prediction.depth),
            "scores": {
                name: PairScores(
                    **{
                        metric: None if math.isnan(value) else value
                        for metric, value in asdict(scored).items()
                    }
                )
                for name, scored in scores.items()
            },
            "numbers": prediction.numbers,
            "warnings": warnings,
        }
    )


def _blank(pair: Pair, status: str) -> PairResult:
    return PairResult(id=pair.id, scene=pair.scene, coordinates=pair.at, status=status)  # type: ignore[arg-type]


def _result(store: Store, method: Method, split: str, pairs: list[PairResult], seed: int) -> Result:
    manifest = store.manifest
    evaluated = [pair for pair in pairs if pair.status == "ok"]
    complete = len(evaluated) == len(pairs)
    trained_on = method.trained_on
    if trained_on is None and "training_mean" in method.uses:
        trained_on = f"{manifest.stem}, split train"
    warnings = []
    printed = sum(bool(pair.warnings) for pair in pairs)
    if printed:
        warnings.append(f"the method printed to standard output on {printed} pairs")
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
            entry=_without_folder(method.entry),
            source_sha256=method.source_sha256,
            parameters=method.parameters,
            uses=list(method.uses),
            trained_on=trained_on,
            paper=method.paper,
        ),
        environment=describe_environment(),
        seed=seed,
        pairs=pairs,
        averages=average(evaluated, list(PROTOCOLS)) if complete else None,
        warnings=warnings,
    )


def _without_folder(entry: str) -> str:
    # A result is for others to read: where a file lay on this machine is none of their business.
    place, _, attribute = entry.rpartition(":")
    return f"{Path(place).name}:{attribute}" if Path(place).is_absolute() else entry


def _seed(seed: int) -> None:
    random.seed(seed)
    np.random.seed(seed)
