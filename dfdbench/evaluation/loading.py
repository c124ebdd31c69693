"""A method loaded with the facts of the data set that it asks for: its blur, lens and depths."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from dfdbench.audit.trained_on import coverage_warnings
from dfdbench.blur.law import SIGMAS, BlurLaw, law_of_fields
from dfdbench.blur.recipe import LEVELS, BlurRecipe, find_recipe
from dfdbench.blur.tracks import find_degradation
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale, Rig
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError, MethodError, Problem, StoreError
from dfdbench.evaluation.fitting import training_scenes
from dfdbench.methods.fitted import Blur
from dfdbench.methods.method import Method
from dfdbench.methods.parameters import read_fields
from dfdbench.methods.registry import Facts, load_method
from dfdbench.optics.thin_lens import ThinLens
from dfdbench.system.location import is_local
from dfdbench.system.strict import problems_of

#: What `recipe` is called where the manifest's lens takes the place of a blur recipe.
RIG = "rig"
_SCALE = "scale"
#: In the order in which `ThinLens` takes them.
_NEEDED = ("defocus_f_number", "focal_length", "focus_distance", "pixel_pitch")
_LENS = (*_NEEDED, "infocus_f_number")
_OF_LAW = tuple(field.name for field in fields(BlurLaw) if field.name != SIGMAS)
# In pixels; so narrow a kernel changes nothing, and a width of 0 is none.
_LEAST_SIGMA = 0.1
_SAY = "say it in FILE.toml (--param recipe=FILE.toml; predict: --lens FILE.toml)"


def load_for(
    store: Dataset,
    method: str | Callable[..., Any],
    parameters: Mapping[str, Any],
    seed: int = 0,
    given_blur: bool = False,
) -> Method:
    """Load a method and hand it the facts of the data set that it asks for.

    A method is named as for `dfdbench.methods.load`, or is the function, class or object itself. A
    class with a parameter ``recipe`` gets the data set's blur recipe
    (None where there is none and the class has a ``fit``), one with ``recipe_name`` that recipe's
    name, empty for captured defocus, one with ``training_mean`` or ``training_median`` that depth
    level of the training split, one with ``seed`` the run's seed, one with ``rig`` a
    `dfdbench.datasets.manifest.Rig` of what the manifest knows of the lens. A recipe that is a
    lens becomes the blur law that follows: see `lens_law`.

    With `given_blur`, a method on a track gets the law of its formation as ``recipe``, see
    `dfdbench.blur.formation.given_law`: what is that knowledge worth? The result then has
    ``recipe`` among the method's uses, by which it has no rank.

    Raises
    ------
    MethodError
        If the method asks for what there is not, takes no blur with `given_blur`, or answers in
        metres where nothing says what the set's levels are in metres, or the other way round.
    """
    images, parameters = images_in(parameters)
    taken, recorded = given_by_lens(store.manifest, parameters)
    found = load_method(method, taken, *_offers(store, seed, given_blur))
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
    """Return which two images the method is to get as a pair, and the other parameters."""
    others = dict(parameters)
    said = others.pop("images", None)
    if said is None:
        return None, others
    numbers = re.findall(r"\d+", str(said))
    if len(numbers) != 2:
        raise MethodError(
            "not two images", where="images", expected="two numbers from 0, as 0,4", got=str(said)
        )
    return (int(numbers[0]), int(numbers[1])), others


def _offers(store: Dataset, seed: int, given_blur: bool) -> tuple[Facts, Facts]:
    """Return what is offered to a class that asks for it, and what instead to one with a fit."""

    def recipe() -> Blur | None:
        return _formation_of(store) if given_blur else store.recipe

    offers: Facts = {
        "recipe": recipe if given_blur else lambda: _recipe_of(store),
        "recipe_name": lambda: store.recipe_name,
        "training_mean": lambda: training_mean(store),
        "training_median": lambda: training_median(store),
        "seed": lambda: seed,
        "rig": lambda: rig_of(store.manifest),
    }
    return offers, {"recipe": recipe}


def _formation_of(store: Dataset) -> Blur | None:
    manifest = store.manifest
    if not manifest.on_track or manifest.recipe is None:
        return store.recipe
    # Here: it needs scipy, which no other method's loading does.
    from dfdbench.blur.formation import given_law

    formation = find_degradation(manifest.degradation).formation
    if formation.planes:
        what, fix = "nobody is given the blur of a focal stack", "leave out --given-blur"
        raise MethodError(what, where=manifest.stem, fix=fix)
    return given_law(find_recipe(manifest.recipe), formation)


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


def depth_warnings(method: Method, store: Dataset, split: str) -> list[str]:
    """Return what a result is to say where training leaves depths of the test uncovered.

    Training is what the method says of itself, and what it is fitted on before the split is run.

    Raises
    ------
    MethodError, StoreError
        As `training_scenes`, for a method that is fitted.
    """
    saw = [method.trained_on]
    if method.learner is not None:
        saw.append(training_scenes(store.manifest, split)[0])
    return [text for name in dict.fromkeys(saw) for text in coverage_warnings(name, store, split)]


def training_mean(store: Dataset) -> float:
    """Return the mean depth level over the known pixels of the training split's depth maps.

    Raises
    ------
    StoreError
        Where the data set has no split ``train``, or the store no pair of it.
    """
    counts = _training_levels(store)
    return int(counts @ np.arange(len(counts))) / int(counts.sum())


def training_median(store: Dataset) -> float:
    """Return the median level, as `training_mean` the mean."""
    counts = _training_levels(store)
    return float(np.searchsorted(np.cumsum(counts), counts.sum() / 2))


def _training_levels(store: Dataset) -> NDArray[np.int64]:
    """Return how many known pixels of the training split's depth maps have each level."""
    splits = [split.name for split in store.manifest.splits]
    if "train" not in splits:
        what = "the method asks for the depth of the training split, and there is no split train"
        fix = "--param training_mean=LEVEL, 0 to 255, or build from a manifest that has one"
        raise StoreError(what, where=str(store.path), fix=fix)
    counts = np.zeros(256, np.int64)
    seen: set[tuple[str, tuple[int, ...]]] = set()
    for pair in store.pairs("train"):
        place = (pair.scene, tuple(pair.at[axis] for axis in store.manifest.depth.axes))
        if place not in seen:
            seen.add(place)
            depth, valid = store.read_levels(pair)
            counts += np.bincount(depth[valid], minlength=256)
    if not counts.any():
        raise StoreError("the store holds no training depth", where=str(store.path))
    return counts


def rig_of(manifest: Manifest) -> Rig:
    """Return what a manifest knows of the lens and camera; each fact None where it does not.

    Where it says no near and far, they are those between which its depth levels lie.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> rig_of(find_manifest("demo")).focal_length is None
    True
    """
    rig, scale = manifest.rig or Rig(), manifest.depth.scale
    if scale is None:
        return rig
    return rig.model_copy(update={"near": rig.near or scale.near, "far": rig.far or scale.far})


def given_by_lens(
    manifest: Manifest, parameters: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return parameters whose `recipe` is a blur law where they name a lens.

    Parameters
    ----------
    manifest : Manifest
        Of the data set: its ``rig`` and ``depth.scale`` say what the user does not.
    parameters : mapping
        Of a method. `recipe` may be ``rig``, or fields of a lens or a TOML file of them, see
        `lens_law`.

    Returns
    -------
    taken : dict
        The parameters, with a `BlurLaw`.
    recorded : dict
        What a result is to say of `recipe` instead of the law's many widths; empty where
        parameters name no lens.

    Raises
    ------
    MethodError
        Where facts are lacking, unknown or wrong, all of them named, or the file cannot be read.
    """
    recipe = parameters.get("recipe")
    where = "parameter recipe"
    if isinstance(recipe, str | Path) and Path(recipe).suffix == ".toml":
        where, recipe = str(recipe), read_fields(recipe)
    if recipe != RIG and not (isinstance(recipe, Mapping) and is_lens(recipe)):
        return dict(parameters), {}
    known = {name: getattr(manifest.rig, name, None) for name in _LENS}
    scale = manifest.depth.scale
    whole = {name: value for name, value in known.items() if value is not None}
    whole |= {_SCALE: scale.model_dump()} if scale else {}
    whole |= {} if recipe == RIG else dict(recipe)
    recorded = {"recipe": RIG if recipe == RIG else whole}
    return {**parameters, "recipe": lens_law(whole, where)}, recorded


def is_lens(given: Mapping[str, Any]) -> bool:
    """Return whether fields describe a lens, rather than a blur recipe or law."""
    return bool(given.keys() & {*_LENS})


def lens_law(given: Mapping[str, Any], where: str = "lens") -> BlurLaw:
    """Return the blur law of a thin lens over the depth levels of a data set.

    Parameters
    ----------
    given : mapping
        ``focal_length``, ``focus_distance`` and ``pixel_pitch`` in metres and
        ``defocus_f_number``; ``scale``, the fields of a `DepthScale`: what levels are in metres.
        ``infocus_f_number`` where the in-focus image has blur of its own. Besides, what a
        `BlurLaw` has beside its widths: ``noise``, ``gain``, ``registered`` and so on.
    where : str
        The file, for messages.

    Raises
    ------
    MethodError
        Where facts are lacking, unknown or wrong, all of them named.

    Notes
    -----
    The widths are `ThinLens.blur_sigma` at each level's distance, at least a tenth of a pixel: at
    the focus there is no blur. The kernels are Gaussians unless ``exponent`` says otherwise, cut
    off beyond three of the largest width unless ``kernel_size`` does.

    Examples
    --------
    >>> law = lens_law({
    ...     "focal_length": 0.025, "defocus_f_number": 2.8, "focus_distance": 1.6,
    ...     "pixel_pitch": 3e-5, "scale": {"law": "inverse", "near": 0.5, "far": 5.0}})
    >>> law.levels, round(law.sigmas[255], 3), law.kernel_size
    (256, 2.598, 17)
    """
    known = (*_LENS, _SCALE, *_OF_LAW)
    problems = [
        Problem("unknown field of a lens", where=where, expected=", ".join(known), got=name)
        for name in given
        if name not in known
    ]
    if lacking := [name for name in (*_NEEDED, _SCALE) if name not in given]:
        what = f"the lens is not known well enough: no {', '.join(lacking)}"
        problems.append(Problem(what, where=where, fix=_SAY))
    MethodError.raise_if(problems)
    rig, scale = _checked(given, where)
    try:
        lens = ThinLens(*(getattr(rig, name) for name in _NEEDED))
        blurred = lens.blur_sigma(scale.to_metres(np.arange(LEVELS)), rig.infocus_f_number)
        sigmas = np.maximum(blurred, _LEAST_SIGMA)
        size = {"kernel_size": 2 * math.ceil(3 * float(sigmas.max())) + 1}
        rest = {name: given[name] for name in _OF_LAW if name in given}
        return law_of_fields({SIGMAS: sigmas.tolist(), **size, **rest})
    except InputError as error:
        raise MethodError.of(
            Problem(p.what, where=f"{where}: {p.where}", expected=p.expected, got=p.got)
            for p in error.problems
        ) from error


def _checked(given: Mapping[str, Any], where: str) -> tuple[Rig, DepthScale]:
    found: list[Any] = []
    problems: list[Problem] = []
    lens = {name: given[name] for name in _LENS if name in given}
    for model, facts, section in ((Rig, lens, ""), (DepthScale, given[_SCALE], _SCALE)):
        try:
            found.append(model.model_validate(facts))
        except ValidationError as error:
            problems += problems_of(error, "wrong fact of a lens", file=where, section=section)
    scale = found[-1] if found else None
    if isinstance(scale, DepthScale) and not scale.near < scale.far:
        got = f"near {scale.near:g}, far {scale.far:g}"
        where = f"{where}: {_SCALE}"
        problems.append(Problem("near is not before far", where=where, got=got))
    MethodError.raise_if(problems)
    return found[0], found[1]
