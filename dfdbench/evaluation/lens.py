"""The lens of a data set, as methods get it: its facts, and the blur law that follows."""

import math
from collections.abc import Mapping
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from dfdbench.blur.law import SIGMAS, BlurLaw, law_of_fields
from dfdbench.blur.recipe import LEVELS
from dfdbench.datasets.depth_scale import DepthScale, Rig
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError, MethodError, Problem
from dfdbench.methods.parameters import read_fields
from dfdbench.optics.thin_lens import ThinLens
from dfdbench.system.strict import problems_of

#: The value of `recipe` that means the manifest's lens.
RIG = "rig"
_SCALE = "scale"
#: The facts that a lens needs, in the order in which `ThinLens` takes them.
_NEEDED = ("defocus_f_number", "focal_length", "focus_distance", "pixel_pitch")
_LENS = (*_NEEDED, "infocus_f_number")
_OF_LAW = tuple(field.name for field in fields_of(BlurLaw) if field.name != SIGMAS)
# In pixels. So narrow a kernel changes nothing, and a width of 0 is not allowed.
_LEAST_SIGMA = 0.1
# In pixels: kernels are at most 999 wide, and no photograph is blurred so much.
_LARGEST_SIGMA = 166
_SAY = "say it in FILE.toml (--param recipe=FILE.toml; predict: --lens FILE.toml)"


class _Lens(Rig):
    """A lens, and what depth levels are in metres."""

    scale: DepthScale


def rig_of(manifest: Manifest) -> Rig:
    """Return what a manifest knows about lens and camera; a fact that it lacks is None.

    If it gives no near and far, they are the distances at the ends of its depth levels.

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
    """Return a method's parameters, with a `recipe` that names a lens replaced by its blur law.

    Parameters
    ----------
    manifest : Manifest
        The data set's; its ``rig`` and ``depth.scale`` fill in what the user leaves out.
    parameters : mapping
        The method's. `recipe` may be ``rig``, or fields of a lens or a TOML file of them, see
        `lens_law`.

    Returns
    -------
    taken : dict
        The parameters, with a `BlurLaw`.
    recorded : dict
        What a result records as `recipe` instead of the law's many widths; empty if the
        parameters name no lens.

    Raises
    ------
    MethodError
        If facts are missing, unknown or wrong (it names all of them), or the file cannot be read.
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


def is_lens(fields: Mapping[str, Any]) -> bool:
    """Return whether fields describe a lens, rather than a blur recipe or law."""
    widths = fields.keys() & {"sigma_min", "sigma_step", SIGMAS}
    return not widths and bool(fields.keys() & {*_LENS, _SCALE, *_OF_LAW})


def lens_law(given: Mapping[str, Any], where: str = "lens") -> BlurLaw:
    """Return the blur law of a thin lens over the depth levels of a data set.

    Parameters
    ----------
    given : mapping
        ``focal_length``, ``focus_distance`` and ``pixel_pitch`` in metres and
        ``defocus_f_number``; ``scale``, the fields of a `DepthScale`: what levels are in metres;
        ``infocus_f_number`` if the in-focus image has blur of its own. Also any field of a
        `BlurLaw` other than its widths: ``noise``, ``gain``, ``registered`` and so on.
    where : str
        The file, for messages.

    Raises
    ------
    MethodError
        If facts are missing, unknown or wrong; it names all of them.

    Notes
    -----
    The widths are `ThinLens.blur_sigma` at each level's distance, but at least a tenth of a pixel,
    since there is no blur at the focus. The kernels are Gaussians unless ``exponent`` says
    otherwise, and are cut off at three times the largest width unless ``kernel_size`` is given.

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
    facts = _checked(given, where)
    try:
        lens = ThinLens(*(getattr(facts, name) for name in _NEEDED))
        distances = facts.scale.to_metres(np.arange(LEVELS))
        blurred = lens.blur_sigma(distances, facts.infocus_f_number)
        sigmas = np.maximum(blurred, _LEAST_SIGMA)
        if (widest := float(sigmas.max())) > _LARGEST_SIGMA:
            # Else the law would name each width, and a lens file has none.
            expected, got = f"at most {_LARGEST_SIGMA} pixels", f"{widest:.4g}"
            what = "too much blur for a photograph: lengths are in metres"
            raise InputError(what, where=", ".join(_NEEDED), expected=expected, got=got)
        size = {"kernel_size": 2 * math.ceil(3 * float(sigmas.max())) + 1}
        rest = {name: given[name] for name in _OF_LAW if name in given}
        return law_of_fields({SIGMAS: sigmas.tolist(), **size, **rest})
    except InputError as error:
        raise MethodError.of(
            Problem(p.what, where=f"{where}: {p.where}", expected=p.expected, got=p.got)
            for p in error.problems
        ) from error


def _checked(given: Mapping[str, Any], where: str) -> _Lens:
    facts = {name: given[name] for name in (*_LENS, _SCALE) if name in given}
    try:
        lens = _Lens.model_validate(facts)
    except ValidationError as error:
        raise MethodError.of(problems_of(error, "wrong fact of a lens", file=where)) from error
    near, far = lens.scale.near, lens.scale.far
    if not near < far:
        got = f"near {near:g}, far {far:g}"
        raise MethodError("near is not before far", where=f"{where}: {_SCALE}", got=got)
    return lens
