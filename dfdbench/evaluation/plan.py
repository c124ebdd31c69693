"""What a run evaluates, and how it recognises an earlier call of the same run."""

import json
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dfdbench.datasets.catalog import default_store
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.errors import MethodError, StoreError
from dfdbench.evaluation.fitting import Fit, fit_sha256
from dfdbench.methods.method import Method
from dfdbench.methods.sources import ABSENT, VALUE, changes
from dfdbench.metrics.protocol import SURE, Protocol, find_protocol, protocols_of, require_scored
from dfdbench.results.environment import software
from dfdbench.results.record import first_protocol
from dfdbench.system.packages import PACKAGE_VERSION
from dfdbench.system.text import differences
from dfdbench.tables.table import listed

# The most characters of a value in a message.
_LONGEST = 60


@dataclass(frozen=True)
class RunOptions:
    """The options of a run.

    Parameters
    ----------
    limit : int, optional
        Evaluate only this many pairs; the run is then incomplete and has no average.
    keep_predictions : bool
        Write the depth maps beside the result; figures need them.
    fresh : bool
        Evaluate all pairs anew.
    seed : int
        Set in `random` and `numpy.random` before each pair; kept in the result.
    fitted : Path, optional
        A run's folder: use what its fit learned, and do not fit again.
    """

    limit: int | None = None
    keep_predictions: bool = True
    fresh: bool = False
    seed: int = 0
    fitted: Path | None = None


@dataclass(frozen=True)
class RunPlan:
    """The pairs of a run.

    Parameters
    ----------
    store : Dataset
        The data set.
    method : Method
        The method to evaluate.
    split : str
        Which pairs.
    options : RunOptions
        The options of the run.
    expected, available, chosen : tuple of Pair
        Pairs of the manifest's split; of those, the ones that the store holds; of those, the ones
        to evaluate.
    fit : Fit or None
        How the method was fitted; None if it has no fit.
    """

    store: Dataset
    method: Method
    split: str
    options: RunOptions
    expected: tuple[Pair, ...]
    available: tuple[Pair, ...]
    chosen: tuple[Pair, ...]
    fit: Fit | None = None

    @property
    def identity(self) -> dict[str, Any]:
        """What must be the same to reuse the pairs of an earlier call."""
        return {
            "dataset": self.store.manifest.stem,
            "manifest_sha256": self.store.manifest.sha256,
            "fingerprint": self.store.fingerprint,
            "split": self.split,
            "protocols": [protocol.as_dict() for protocol in protocols_on(self.store)],
            "keep_predictions": self.options.keep_predictions,
            # With the blur given, the same method, parameters and data are a different run.
            "given_blur": self.store.manifest.on_track and "recipe" in self.method.uses,
            **identity_of(self.method, self.options.seed, self.options.fitted),
        }


def identity_of(method: Method, seed: int, fitted: Path | None = None) -> dict[str, Any]:
    """Return what must be the same about a method to reuse its earlier answers."""
    identity = {
        "dfdbench": PACKAGE_VERSION,
        "entry": method.entry,
        "parameters": method.parameters,
        "weights_sha256": method.weights_sha256,
        "files_sha256": method.files_sha256,
        "seed": seed,
        "software": software(),
        "used": method.used,
        "fitted_sha256": fit_sha256(fitted) if fitted else None,
    }
    # `default` is for a seed of NumPy's.
    return dict(json.loads(json.dumps(identity, default=operator.index)))


def differences_from(
    before: Mapping[str, Any], identity: Mapping[str, Any], method: Method
) -> list[str]:
    """Return how a call differs from an earlier one; nothing if its answers may be reused.

    Files that the earlier call used are hashed again, since we do not know yet which files this
    call will open.

    Parameters
    ----------
    before, identity : mapping
        The identity of each call: `identity_of`, and more.
    method : Method
        The method of this call.
    """
    now = dict(identity)
    used = before.get("used")
    if not isinstance(used, dict) or not used:
        return ["it scored other maps" if before.get("scored") else "its record is damaged"]
    # All else that differs follows from the data set; one is also known by its manifest's hash.
    name, was = now.pop("dataset", None), before.get("dataset")
    if was and was != name:
        return [f"data set was {was} and is {name}"]
    used_now = now.pop("used")
    said = [
        f"{name.removeprefix('software.')} was {_short(one)} and is {_short(other)}"
        for name, one, other in differences({name: before.get(name) for name in now}, now)
    ]
    said += changes(used, used_now | method.used_again(used))
    said += [
        f"{label} was not used before"
        for label, found in used_now.items()
        if label not in used and found not in (None, ABSENT) and not label.startswith(VALUE)
    ]
    return said


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def protocols_on(store: Dataset) -> tuple[Protocol, ...]:
    """Return the protocols to score under on a data set.

    They include those in metres if its manifest says how levels become metres.
    """
    depth = store.manifest.depth
    return tuple(protocols_of(depth.scale is not None, depth.kind).values())


def protocol_on(manifest: Manifest, name: str | None) -> str:
    """Return the label of a protocol, checking that runs on a data set are scored under it.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    name : str or None
        The protocol's name; None for the data set's first.

    Raises
    ------
    UnknownNameError
        If there is no such protocol, or runs on this data set are not scored under it.
    """
    label = find_protocol(name).label if name else first_protocol(manifest.short)
    there = [*protocols_of(manifest.depth.scale is not None, manifest.depth.kind), SURE]
    require_scored(label, there, f"runs on {manifest.stem}")
    return label


def plan_run(store: Dataset, method: Method, split: str, options: RunOptions) -> RunPlan:
    """Plan which pairs a run evaluates.

    Raises
    ------
    StoreError
        If the store holds no pair of the split, or has lost something that was built.
    MethodError
        If the method needs stacks and the store holds pairs.
    """
    require_scorable(store, split)
    available = store.some_pairs(split)
    require_stacks(method, store, available[0])
    expected = store.manifest.pairs(split)
    chosen = available[: options.limit]
    return RunPlan(store, method, split, options, expected, available, chosen)


def require_stacks(method: Method, store: Dataset, pair: Pair) -> None:
    """Raise if a method needs stacks and the data set has pairs."""
    dot = (slice(1), slice(1))
    if method.attribute("needs_stack") and store.read(pair, dot).is_pair:
        manifest = store.manifest
        what = f"{method.name} needs a focal stack, and {manifest.short} holds pairs"
        fix = "name a method of pairs, as sgm; or build stacks: dfdbench build demo@stack-9"
        if manifest.recipe and not manifest.on_track:
            fix = f"dfdbench build {manifest.short}@stack-9, and name that as --dataset"
        raise MethodError(what, where=str(store.path), fix=fix)


def require_scorable(store: Dataset, split: str) -> None:
    """Raise if there is no depth to score against, or a store has lost what was built of a split.

    The fingerprint of a store that has lost scenes or pairs, which a result records, no longer
    matches its content. Anything that was already missing when it was built is different: the store
    records it, and a run is incomplete.

    Raises
    ------
    StoreError
        If there is no depth, or scenes or pairs were lost; it names the scenes.
    """
    manifest = store.manifest
    if not manifest.has_truth:
        name = manifest.short
        export = f"dfdbench export {name} --png IMAGES --images-only"
        fix = f"{export}, then dfdbench predict IMAGES --method NAME --out MAPS"
        raise StoreError(f"{name} has no depth to score against", where=str(store.path), fix=fix)
    lacking = set(store.attributes.get("missing_pairs", ()))
    there = {pair.id for pair in store.pairs(split)} | lacking
    # For other scenes, on which a method may be fitted, only check that they exist.
    whole = set(manifest.scene_names) - set(store.scenes)
    gone = [p for p in manifest.pairs("all") if p.id not in lacking and p.scene in whole]
    gone += [pair for pair in manifest.pairs(split) if pair.id not in there]
    if lost := dict.fromkeys(pair.scene for pair in gone):
        what = f"the store has lost scenes that were built, or their pairs: {listed(lost, most=10)}"
        raise StoreError(what, where=str(store.path), fix=f"dfdbench build {_as_built(store)}")


def _as_built(store: Dataset) -> str:
    name = store.manifest.short + " --source DIR" * bool(store.manifest.files)
    at_home = str(store.path) == str(default_store(store.manifest))
    return name if at_home else f"{name} --store {store.path}"
