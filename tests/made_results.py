"""Results made by hand, for the tests of what reads them."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from dfdbench.blur.recipe import RECIPES
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Pair
from dfdbench.metrics.protocol import PROTOCOLS, RELEASED
from dfdbench.results.environment import describe_environment
from dfdbench.results.record import DatasetRecord, MethodRecord, PairResult, Result, average
from dfdbench.results.saved_run import SavedRun
from dfdbench.system.strict import Record

Made = TypeVar("Made", bound=Record)
# Asking every package and git for each of a hundred results takes half a minute.
_environment = cache(describe_environment)


def _scored(pair: Pair, nrmse: float | None, protocols: Sequence[str]) -> PairResult:
    half, rest = (None, 0.5) if nrmse is None else (nrmse / 2, 1 - nrmse)
    scores = {"nrmse": nrmse, "nmae": half, "ssim": rest}
    return PairResult(
        id=pair.id,
        scene=pair.scene,
        coordinates=pair.at,
        status="ok",
        seconds=0.25,
        prediction_sha256="0" * 64,
        scores=dict.fromkeys(protocols, scores),
    )


def make_result(
    nrmse: Mapping[tuple[str, int, int, int], float | None], name: str = "mine"
) -> Result:
    """A complete result under protocol thesis, from NRMSE by (scene, view, illum., exposure).

    NMAE is half the NRMSE, SSIM one less it.
    """
    axes = ("view", "illumination", "exposure")
    pairs = [
        _scored(Pair(scene, tuple(zip(axes, place, strict=True))), value, ("thesis",))
        for (scene, *place), value in nrmse.items()
    ]
    return Result(
        schema_version=1,
        dataset=DatasetRecord(
            name="tiny-1",
            short="tiny",
            manifest_sha256="1" * 64,
            fingerprint="2" * 64,
            split="test",
            expected=len(pairs),
            evaluated=len(pairs),
            recipe={"name": "published", "parameters": RECIPES["published"].as_dict()},
            degradation="clean",
            options={},
            axes=list(axes),
            blocks="exposure",
            rows="illumination",
        ),
        protocols=[PROTOCOLS["thesis"].as_dict()],
        method=MethodRecord(
            name=name,
            entry="mine:predict",
            source_sha256=None,
            parameters={},
            uses=[],
            trained_on=None,
            paper=None,
        ),
        environment=_environment(),
        seed=0,
        pairs=pairs,
        averages=average(pairs, ["thesis"]),
    )


def make_demo_result(
    nrmse: Callable[[Pair], float],
    name: str = "mine",
    parameters: dict[str, Any] | None = None,
    fingerprint: str = "2" * 64,
    protocols: tuple[str, ...] = ("valid",),
    dataset: str = "demo",
    split: str = "test",
) -> Result:
    """A complete result on a set's split; NMAE is half the NRMSE."""
    manifest = find_manifest(dataset)
    pairs = [_scored(pair, nrmse(pair), protocols) for pair in manifest.pairs(split)]
    return edited(
        make_result({("a", 1, 1, 0): 0.1}, name),
        dataset={
            "name": manifest.stem,
            "short": manifest.short,
            "axes": list(manifest.axes),
            "blocks": manifest.table.blocks,
            "rows": manifest.table.rows,
            "simulated": manifest.simulated,
            "groups": manifest.groups,
            "split": split,
            "manifest_sha256": manifest.sha256,
            "fingerprint": fingerprint,
            "expected": len(pairs),
            "evaluated": len(pairs),
        },
        method={"parameters": parameters or {}},
        protocols=[RELEASED[label].as_dict() for label in protocols],
        pairs=pairs,
        averages=average(pairs, list(protocols)),
    )


def saved(folder: Path, *results: Result) -> list[SavedRun]:
    """Runs without depth maps, whose files hold nothing: only their age is read."""
    runs = []
    for number, result in enumerate(results):
        path = folder / f"{number}.json"
        path.touch()
        runs.append(SavedRun(path, result, None, "no depth maps"))
    return runs


def limited(result: Result, count: int) -> Result:
    """The same run, stopped after some pairs."""
    blank: dict[str, Any] = {"scores": {}, "seconds": None, "prediction_sha256": None}
    stopped = [edited(pair, status="not-run", **blank) for pair in result.pairs[count:]]
    pairs = result.pairs[:count] + stopped
    return edited(result, pairs=pairs, dataset={"evaluated": count}, averages=None)


def edited(record: Made, **fields: Any) -> Made:
    """The record with other fields; a mapping edits the record there, or every one of `pairs`."""
    for name, change in fields.items():
        there = getattr(record, name)
        if isinstance(change, dict) and isinstance(there, Record):
            fields[name] = edited(there, **change)
        elif isinstance(change, dict) and name == "pairs":
            fields[name] = [edited(pair, **change) for pair in there]
    return record.model_copy(update=fields)
