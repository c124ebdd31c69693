"""Build a data set: read source images and a blur recipe, write a store."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray
from upath import UPath

from dfdbench.blur.formation import focus_levels, form_pair, form_stack
from dfdbench.blur.recipe import LAST_LEVEL, BlurRecipe, find_recipe
from dfdbench.blur.synthesis import synthesize
from dfdbench.blur.tracks import find_degradation
from dfdbench.building.sources import SceneError, SceneImages, Source
from dfdbench.datasets.captured_files import BY_IMAGE, OF_CAMERA
from dfdbench.datasets.captures import PAIR, ROLES, ImageFacts
from dfdbench.datasets.catalog import default_store
from dfdbench.datasets.depth_scale import Rig
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.datasets.store_writer import SceneWriter, StoreWriter
from dfdbench.errors import Problem, SourceError, refuse_alone, refuse_both
from dfdbench.system.location import Place, as_location, is_local
from dfdbench.system.parallel import Pool, Threads
from dfdbench.tables.table import counted, grouped, listed


def refuse_another_set(
    manifest: Manifest,
    place: UPath,
    recipe: str | None,
    steps: tuple[int, int] | None,
    cache: Path | str | None = None,
) -> None:
    """Keep another recipe or other steps out of the data set's default place.

    A data set on a track never takes a recipe: the track has a blur of its own.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    place : UPath
        The store to write.
    recipe : str or None
        A blur recipe's name, in place of the manifest's.
    steps : tuple of int or None
        In-focus and defocus voltage step, in place of the manifest's.
    cache : Path or str, optional
        The cache folder; see `dfdbench.system.cache.cache_folder`.

    Raises
    ------
    UnknownNameError
        If there is no such recipe.
    InputError
        If `place` is the data set's own but recipe or steps are not; if both a recipe and a track
        are named.
    """
    if recipe is not None:
        find_recipe(recipe)
    refuse_both({manifest.short: manifest.on_track}, {"--recipe": recipe})
    own = os.path.realpath(default_store(manifest, cache))
    if not is_local(place) or os.path.realpath(place.path) != own:
        return
    usual = manifest.capture and (manifest.capture.infocus_step, manifest.capture.defocus_step)
    other = {f"--recipe {recipe}": recipe not in (None, manifest.recipe)}
    other["--pair"] = steps is not None and usual not in (None, steps)
    refuse_alone(other, {"--store PATH of its own": None})


@dataclass(frozen=True)
class BuildReport:
    """What a build did.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    path : UPath
        The store.
    fingerprint : str
        SHA-256 over the arrays of its scenes; it does not cover the attributes.
    scenes_built, scenes_kept : tuple of str
        Scenes written now, and complete ones kept from before.
    pairs : int
        Pairs in the store.
    missing : tuple of Pair
        Pairs of the manifest that the source lacks, or whose scenes were left out.
    problems : tuple of Problem
        Why scenes were left out.
    warnings : tuple of str
        What looks odd in scenes that were built.
    missing_help : str
        How to get the missing pairs; empty if there are none.
    """

    manifest: Manifest
    path: UPath
    fingerprint: str
    scenes_built: tuple[str, ...]
    scenes_kept: tuple[str, ...]
    pairs: int
    missing: tuple[Pair, ...]
    problems: tuple[Problem, ...] = ()
    warnings: tuple[str, ...] = ()
    missing_help: str = ""


def build_store(
    manifest: Manifest,
    source: Source,
    place: Place,
    recipe: str | None = None,
    pool: Pool | None = None,
    on_scene: Callable[[int, int], None] | None = None,
) -> BuildReport:
    """Build a data set and move it into place as a whole.

    Scenes that an earlier, interrupted call finished from the same files are kept. Missing pairs,
    and scenes that the source leaves out (`SceneError`), are reported. Any other damaged file stops
    the build once all files were checked.

    Parameters
    ----------
    manifest : Manifest
        The data set, and the track that it is on, if any.
    source : Source
        Where its images come from.
    place : str, Path or UPath
        The store to write: a local path or a URL.
    recipe : str, optional
        A blur recipe's name; by default the manifest's. Captured defocus has none.
    pool : Pool, optional
        Where scenes are made, and how many at once; by default one after the other. The store does
        not depend on it. The workers of a cluster must be able to reach source and store.
    on_scene : callable, optional
        Called with (scenes done, total scenes).

    Raises
    ------
    SourceError
        If files are damaged (all of them are named) or there are none; if the source's defocus is
        captured and a recipe is named, or neither.
    StoreError
        If the store cannot be written, or another build is writing it.
    InputError
        If another recipe or other voltage steps would go into the data set's default place; if a
        recipe is named for a data set on a track.
    """
    steps = source.options.get("pair")
    pair = tuple(steps) if isinstance(steps, list) else None
    made_by = _recipe_of(manifest, source, recipe)
    refuse_another_set(manifest, as_location(place), recipe, pair)
    blur = find_recipe(made_by) if made_by else None
    available = set(source.available_pairs())
    missing = tuple(pair for pair in manifest.pairs() if pair not in available)
    scenes = [name for name in manifest.scene_names if any(p.scene == name for p in available)]
    if not scenes:
        raise SourceError("nothing to build", fix=source.missing_help(missing))
    left_out = [pair.id for pair in missing]
    with StoreWriter(place, manifest, _attributes(manifest, source, made_by)) as writer:
        writer.refuse_to_lose(left_out)
        build = partial(_build_scene, manifest, source, blur, writer.scenes)
        outcomes = (pool or Threads()).map(build, scenes, on_done=on_scene)
        _refuse_damage(outcomes, source, missing, writer)
        there = {outcome.scene: outcome.digest for outcome in outcomes if outcome.digest}
        missing = tuple(p for p in manifest.pairs() if p not in available or p.scene not in there)
        left_out = [pair.id for pair in missing]
        writer.refuse_to_lose(left_out, _told_once(outcomes))
        fingerprint = writer.finish(there, left_out)
    return BuildReport(
        manifest,
        writer.path,
        fingerprint,
        tuple(outcome.scene for outcome in outcomes if outcome.digest and not outcome.kept),
        tuple(outcome.scene for outcome in outcomes if outcome.kept),
        sum(pair.scene in there for pair in available),
        missing,
        _told_once(outcomes),
        (*_found_fewer(manifest), *(text for outcome in outcomes for text in outcome.warnings)),
        source.missing_help(missing) if missing else "",
    )


def _found_fewer(manifest: Manifest) -> tuple[str, ...]:
    count = len(manifest.scenes)
    if not manifest.find_scenes or count == manifest.scene_count:
        return ()
    return (f"{counted(count, 'scene')} found; {manifest.short} has {manifest.scene_count}",)


@dataclass(frozen=True)
class _Outcome:
    scene: str
    digest: str = ""
    kept: bool = False
    problems: tuple[Problem, ...] = ()
    left_out: bool = False
    warnings: tuple[str, ...] = ()


def _build_scene(
    manifest: Manifest, source: Source, blur: BlurRecipe | None, writer: SceneWriter, scene: str
) -> _Outcome:
    """Build one scene, perhaps in another process."""
    try:
        signature = source.signature(scene)
        if digest := writer.digest_of_finished(scene, signature):
            return _Outcome(scene, digest, kept=True)
        images = source.read(scene)
        digest = writer.write(scene, scene_dataset(manifest, scene, images, blur), signature)
        return _Outcome(scene, digest, warnings=images.warnings)
    except SourceError as error:
        # Reported together with those of the other scenes.
        left_out = isinstance(error, SceneError)
        return _Outcome(scene, problems=error.problems, left_out=left_out)


def scene_dataset(
    manifest: Manifest, scene: str, images: SceneImages, blur: BlurRecipe | None
) -> xarray.Dataset:
    """Return a scene's arrays; make the defocus images unless they were captured.

    If the depth grows with distance, it is inverted before the blur (Eq. 7.1 of the thesis). On a
    track the in-focus images change as well.

    Raises
    ------
    SourceError
        If there are both a recipe and captured images, or neither.
    """
    axes = manifest.axes
    captured = "defocus" in images.facts.roles
    if captured == (blur is not None):
        what = "either the source captures defocus or a recipe makes it, not both or neither"
        raise SourceError(what, where=manifest.stem, fix="mend the source's captures_defocus")
    if blur is not None:
        images = _synthesised(manifest, scene, images, blur)
    facts, known = images.facts, _known(images.facts, manifest)
    extent = (*(len(values) for values in axes.values()), len(facts.roles))
    variables: dict[str, tuple[tuple[str, ...], Any]] = {
        "images": ((*axes, "image", "y", "x", "channel"), images.images),
        "depth": ((*manifest.depth.axes, "y", "x"), images.depth),
        "available": (tuple(axes), images.available),
    }
    coordinates: dict[str, Any] = {
        axis: np.asarray(values, np.int64) for axis, values in axes.items()
    }
    coordinates["role"] = ("image", np.array([ROLES.index(role) for role in facts.roles], np.uint8))
    coordinates |= {
        name: ((*axes, "image"), np.broadcast_to(known[name], extent)) for name in BY_IMAGE
    }
    coordinates |= {name: ((), known[name]) for name in OF_CAMERA}
    found = {"found": dict(images.found)} if images.found else None
    return xarray.Dataset(variables, coords=coordinates, attrs=found)


def _known(facts: ImageFacts, manifest: Manifest) -> dict[str, Any]:
    """Return what is known of the images, from the source or else from the manifest."""
    rig = manifest.rig or Rig()
    by_role = {"infocus": rig.infocus_f_number, "defocus": rig.defocus_f_number}
    stated = {
        "f_number": [by_role[role] for role in facts.roles],
        "focus_distance": [rig.focus_distance] * len(facts.roles),
        "focus_depth": None,
        "focal_length": rig.focal_length,
        "pixel_pitch": rig.pixel_pitch,
    }
    known: dict[str, Any] = {}
    for name, value in stated.items():
        own = getattr(facts, name)
        # As a number, None is NaN.
        known[name] = np.where(np.isnan(own), np.array(value, np.float64), own)
    if manifest.depth.scale is not None:
        focus = known["focus_depth"]
        focused = manifest.depth.of_metres(known["focus_distance"])
        known["focus_depth"] = np.where(np.isfinite(focus), focus, focused)
    return known


def _attributes(manifest: Manifest, source: Source, made_by: str | None) -> dict[str, Any]:
    recipe: dict[str, Any] = {"name": "", "parameters": {}}
    track: dict[str, Any] = {}
    if manifest.on_track:
        # A track does not reveal how its images were made.
        track = {"track_version": find_degradation(manifest.degradation).track.version}
    elif made_by:
        recipe = {"name": made_by, "parameters": manifest.depth.own_recipe(made_by).as_dict()}
    return {
        "recipe": recipe,
        "degradation": manifest.degradation,
        "depth_unit": manifest.depth.unit,
        "depth_grows_with": manifest.depth.grows_with,
        "options": dict(source.options),
        **track,
    }


def _told_once(outcomes: Sequence[_Outcome]) -> tuple[Problem, ...]:
    """Return the scenes' problems; a problem with a file that many scenes share appears once."""
    problems = dict.fromkeys(problem for outcome in outcomes for problem in outcome.problems)
    alike = grouped(((problem.what, problem.where), problem) for problem in problems)
    return tuple(
        replace(first, got=f"{first.got} and {len(others)} more") if others else first
        for first, *others in alike.values()
    )


def _refuse_damage(
    outcomes: Sequence[_Outcome], source: Source, missing: tuple[Pair, ...], writer: StoreWriter
) -> None:
    if all(outcome.left_out for outcome in outcomes):
        raise SourceError.of(_told_once(outcomes))
    problems = [
        problem for outcome in outcomes for problem in outcome.problems if not outcome.left_out
    ]
    if problems and missing:
        named = listed([pair.id for pair in missing], 3)
        what = f"{len(missing)} pairs are missing besides: {named}"
        problems.append(Problem(what, fix=source.missing_help(missing)))
    if problems and (whole := len(writer.waiting)):
        what = f"{counted(whole, 'scene')} that can be used are kept for the same command"
        problems.append(Problem(what, where=str(writer.partial)))
    SourceError.raise_if(problems)


def _recipe_of(manifest: Manifest, source: Source, recipe: str | None) -> str | None:
    """Return the blur recipe's name; None if the defocus images are captured."""
    name = recipe or manifest.recipe
    if source.captures_defocus and name:
        # A store must not name a blur that its images do not have.
        where = "--recipe" if recipe else f"{manifest.stem}: recipe"
        what = f"no recipe {name} made the defocus images of {manifest.short}: they are captured"
        fix = "leave it out; realworld-synthetic blurs the thesis's captures"
        raise SourceError(what, where=where, fix=fix)
    if source.captures_defocus:
        return None
    if name is None:
        raise SourceError(f"{manifest.short} names no blur recipe", fix="--recipe NAME")
    return name


def _synthesised(
    manifest: Manifest, scene: str, images: SceneImages, blur: BlurRecipe
) -> SceneImages:
    """Return a scene with its defocus images made; the in-focus ones change on a track only."""
    on = find_degradation(manifest.degradation) if manifest.on_track else None
    planes = on.formation.planes if on else 0
    sharp = images.infocus
    made = np.zeros((*sharp.shape[:-3], 1 + (planes or 1), *sharp.shape[-3:]), np.uint8)
    levels = manifest.depth.levels_of(images.depth)
    for place in np.ndindex(images.available.shape):
        if images.available[place]:
            at = dict(zip(manifest.axes, place, strict=True))
            depth = levels[tuple(at[axis] for axis in manifest.depth.axes)]
            if manifest.depth.grows_with == "distance":
                depth = LAST_LEVEL - depth
            if on is None:
                made[place] = sharp[place], synthesize(sharp[place], depth, blur)
            elif planes:
                made[place][0] = sharp[place]
                made[place][1:] = form_stack(sharp[place], depth, blur, planes)
            else:
                values = tuple((axis, manifest.axes[axis][index]) for axis, index in at.items())
                made[place] = form_pair(sharp[place], depth, blur, on, Pair(scene, values).id)
    if not planes or on is None:
        return replace(images, images=made, facts=replace(images.facts, roles=PAIR))
    focus = np.array([np.nan, *focus_levels(planes)])
    if manifest.depth.grows_with == "distance":
        focus = LAST_LEVEL - focus
    roles = PAIR[:1] + PAIR[1:] * planes
    scale, first = manifest.depth.scale, 0 if on.formation.infocus else 1
    metres = np.full(len(focus), np.nan) if scale is None else scale.to_metres(focus)
    facts = replace(
        images.facts, roles=roles[first:], focus_depth=focus[first:], focus_distance=metres[first:]
    )
    return replace(images, images=made[..., first:, :, :, :], facts=facts)
