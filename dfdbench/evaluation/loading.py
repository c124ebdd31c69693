"""Load a method with the facts of the data set that it asks for."""

import contextlib
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.trained_on import coverage_warnings
from dfdbench.blur.recipe import BlurRecipe
from dfdbench.blur.tracks import find_degradation
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import ALL_PAIRS
from dfdbench.errors import DfdbenchError, MethodError, StoreError
from dfdbench.evaluation.fitting import mean_scenes, read_fit, training_scenes
from dfdbench.evaluation.lens import given_by_lens, rig_of
from dfdbench.methods.fitted import Blur
from dfdbench.methods.method import Method
from dfdbench.methods.registry import Facts, load_method
from dfdbench.system.location import is_local


def load_for(
    store: Dataset,
    method: str | Callable[..., Any],
    parameters: Mapping[str, Any],
    seed: int = 0,
    given_blur: bool = False,
    split: str = "test",
) -> Method:
    """Load a method and give it the facts of the data set that it asks for.

    A method is named as for `dfdbench.methods.load`, or is the function, class or object itself. A
    class gets facts by the names of its parameters: ``recipe``, the data set's blur recipe (None
    if there is none and the class has a ``fit``); ``recipe_name``, that recipe's name, empty for
    captured defocus; ``training_mean`` or ``training_median``, that depth level of the scenes that
    `mean_scenes` names for `split`; ``seed``, the run's seed; ``rig``, a
    `dfdbench.datasets.manifest.Rig` of what the manifest knows about the lens. A recipe that is a
    lens becomes the blur law that follows from it: see `dfdbench.evaluation.lens`.

    With `given_blur`, a method on a track gets the law of the track's formation as ``recipe``, see
    `dfdbench.blur.formation.given_law`. Such a run shows what that knowledge is worth. Its result
    has ``recipe`` among the method's uses, and so no rank.

    Raises
    ------
    MethodError
        If the method asks for a fact that does not exist, or takes no blur with `given_blur`; if it
        answers in metres and nothing converts the set's levels to metres, or the other way round.
    """
    images, parameters = images_in(parameters)
    taken, recorded = given_by_lens(store.manifest, parameters)
    found = load_method(method, taken, *_offers(store, seed, given_blur, split))
    if is_local(store.path):
        found.sources.apart = (Path(str(store.path)),)
    if given_blur and "recipe" not in found.uses:
        what = "nothing to give: the method does not ask for the blur recipe, or was given one"
        fix = "leave out --given-blur, or --param recipe"
        raise MethodError(what, where=found.entry, fix=fix)
    depth = store.manifest.depth
    if found.answers_in(depth.kind) != depth.kind and depth.scale is None:
        what = (
            f"it answers in metres, and {store.manifest.stem} does not say how levels become metres"
        )
        fix = "put depth.scale into the manifest, or choose a method that answers in levels"
        raise MethodError(what, where=found.name, fix=fix)
    named = {} if images is None else {"images": list(images)}
    return replace(found, images=images, parameters=found.parameters | recorded | named)


def images_in(parameters: Mapping[str, Any]) -> tuple[tuple[int, int] | None, dict[str, Any]]:
    """Return which two images the method gets as a pair, and the other parameters."""
    others = dict(parameters)
    said = others.pop("images", None)
    if said is None:
        return None, others
    numbers = re.findall(r"-?[\d.]+", str(said))
    if len(numbers) != 2 or not all(map(str.isdecimal, numbers)):
        raise MethodError(
            "not two images", where="images", expected="two numbers from 0, as 0,4", got=str(said)
        )
    return (int(numbers[0]), int(numbers[1])), others


def _offers(store: Dataset, seed: int, given_blur: bool, split: str) -> tuple[Facts, Facts]:
    """Return the facts that a class may ask for, and those that replace them if it has a fit."""

    def recipe() -> Blur | None:
        return _formation_of(store) if given_blur else store.recipe

    offers: Facts = {
        "recipe": recipe if given_blur else lambda: _recipe_of(store),
        "recipe_name": lambda: store.recipe_name,
        "training_mean": lambda: training_mean(store, split),
        "training_median": lambda: training_median(store, split),
        "seed": lambda: seed,
        "rig": lambda: rig_of(store.manifest),
    }
    return offers, {"recipe": recipe}


def _formation_of(store: Dataset) -> Blur | None:
    manifest = store.manifest
    if not manifest.on_track or manifest.recipe is None:
        return store.recipe
    # Imported here because it needs scipy, which loading otherwise does not.
    from dfdbench.blur.formation import given_law

    formation = find_degradation(manifest.degradation).formation
    if formation.planes:
        what, fix = "nobody is given the blur of a focal stack", "leave out --given-blur"
        raise MethodError(what, where=manifest.stem, fix=fix)
    return given_law(manifest.depth.own_recipe(manifest.recipe), formation)


def _recipe_of(store: Dataset) -> BlurRecipe:
    if store.recipe is not None:
        return store.recipe
    what = "the method asks for a blur recipe, and captured images have none"
    fix = (
        "--param recipe=FILE.toml describes a lens, recipe=rig takes the manifest's; "
        "recipe=published gives a recipe, but not how these images were made"
    )
    if store.manifest.on_track:
        what = "the method asks for the blur recipe, and a track does not give it"
        fix = "choose one that is fitted; --param recipe=published gives one, but not the true one"
    raise MethodError(what, where=store.manifest.short, fix=fix)


def depth_warnings(
    method: Method, store: Dataset, split: str, fitted: Path | None = None
) -> list[str]:
    """Return the result's warnings if training does not cover all depths of the test.

    Training is what the method says it was trained on, and what it is fitted on before the run or
    in the run `fitted`.

    Raises
    ------
    MethodError, StoreError
        As for `training_scenes`, if the method is fitted.
    """
    saw = [method.trained_on]
    if fitted is not None:
        # Whether it is a run of a fit at all is told when the fit is taken over.
        with contextlib.suppress(DfdbenchError):
            saw.append(read_fit(fitted).fitted_on)
    elif method.learner is not None:
        saw.append(training_scenes(store.manifest, split)[0])
    return [text for name in dict.fromkeys(saw) for text in coverage_warnings(name, store, split)]


def training_mean(store: Dataset, split: str = "test") -> float:
    """Return the mean depth level over known pixels of the depth maps in `mean_scenes`.

    Raises
    ------
    StoreError
        If nothing is trained on, or the store has no pair of it.
    """
    counts = _training_levels(store, split)
    return int(counts @ np.arange(len(counts))) / int(counts.sum())


def training_median(store: Dataset, split: str = "test") -> float:
    """Return the median depth level; otherwise as `training_mean`."""
    counts = _training_levels(store, split)
    return float(np.searchsorted(np.cumsum(counts), counts.sum() / 2))


def _training_levels(store: Dataset, split: str) -> NDArray[np.int64]:
    """Return the number of known pixels at each level in the training depth maps."""
    scenes = mean_scenes(store.manifest, split)[1]
    counts = np.zeros(256, np.int64)
    seen: set[tuple[str, tuple[int, ...]]] = set()
    for pair in (pair for pair in store.pairs(ALL_PAIRS) if pair.scene in scenes):
        place = (pair.scene, tuple(pair.at[axis] for axis in store.manifest.depth.axes))
        if place not in seen:
            seen.add(place)
            depth, valid = store.read_levels(pair)
            counts += np.bincount(depth[valid], minlength=256)
    if not counts.any():
        raise StoreError("the store holds no training depth", where=str(store.path))
    return counts
