"""What a build is to make and where: another blur or other voltage steps are another data set."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from upath import UPath

from dfdbench.blur.recipe import find_recipe
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.store_place import default_store
from dfdbench.errors import InputError
from dfdbench.system.location import Place, as_location, is_local


@dataclass(frozen=True)
class BuildPlan:
    """What `plan_build` found to be one data set.

    Parameters
    ----------
    manifest : Manifest
        What belongs to it.
    place : UPath
        The store to write.
    recipe : str or None
        The name of the blur recipe that was asked for; None for the manifest's.
    steps : tuple of int, or None
        The in-focus and the defocus voltage step that were asked for; None for the manifest's.
    """

    manifest: Manifest
    place: UPath
    recipe: str | None = None
    steps: tuple[int, int] | None = None


def plan_build(
    manifest: Manifest,
    store: Place | None = None,
    recipe: str | None = None,
    steps: tuple[int, int] | None = None,
    cache: Path | None = None,
) -> BuildPlan:
    """Return a build's plan; what is not the manifest's own data set needs a place of its own.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    store : str, Path or UPath, optional
        The store to write; by default the data set's place in the cache.
    recipe : str, optional
        A blur recipe's name, in place of the manifest's.
    steps : tuple of int, optional
        In-focus and defocus voltage step, in place of the manifest's.
    cache : Path, optional
        The cache folder; see `dfdbench.system.cache.cache_folder`.

    Raises
    ------
    UnknownNameError
        Where there is no such recipe.
    InputError
        Where the data set's default place would get another recipe or other steps; where a
        recipe is named with a track.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> plan_build(find_manifest("demo"), "my.zarr", "text").recipe
    'text'
    """
    if recipe is not None:
        find_recipe(recipe)
    place = as_location(store or default_store(manifest, cache))
    refuse_another_set(manifest, place, recipe, steps, cache)
    return BuildPlan(manifest, place, recipe, steps)


def refuse_another_set(
    manifest: Manifest,
    place: UPath,
    recipe: str | None,
    steps: tuple[int, int] | None,
    cache: Path | None = None,
) -> None:
    """Keep another recipe and other steps out of the place where the data set itself belongs.

    A data set on a track takes no recipe anywhere: the track has a blur of its own.

    The parameters are those of `plan_build`; `place` is the store to write.

    Raises
    ------
    InputError
        If `place` is the data set's own, and recipe or steps are not; if both a recipe and a track
        are named.
    """
    if recipe is not None and manifest.on_track:
        what = f"a track decides how its images are made: no recipe {recipe} on {manifest.short}"
        fix = f"leave out --recipe, or the track, @{manifest.degradation}"
        raise InputError(what, where="--recipe", fix=fix)
    own = os.path.realpath(default_store(manifest, cache))
    if not is_local(place) or os.path.realpath(place.path) != own:
        return
    if recipe not in (None, manifest.recipe):
        what = f"another blur recipe, {recipe} and not {manifest.recipe}, makes another data set"
        raise InputError(what, where="--recipe", fix="name its place: --store PATH")
    usual = manifest.capture and (manifest.capture.infocus_step, manifest.capture.defocus_step)
    if steps is not None and usual not in (None, steps):
        named = ",".join(map(str, steps))
        what = f"other voltage steps, {named} and not {usual}, make another data set"
        raise InputError(what, where="--pair", fix="name its place: --store PATH")
