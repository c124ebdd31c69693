"""A method's parameters as the user sets them: blur recipes, and the content of named files."""

import hashlib
import itertools
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dfdbench import errors
from dfdbench.blur.law import SIGMAS, BlurLaw, law_of_fields
from dfdbench.blur.recipe import RECIPES, BlurRecipe, find_recipe
from dfdbench.methods.sources import sha256_of
from dfdbench.system.files import read_text
from dfdbench.system.text import parse_toml

# The limit for a folder that a parameter names, since all of it is hashed before every run.
_MOST_FILES = 10_000
_MOST_BYTES = 20 * 10**9


def read_parameters(
    given: Mapping[str, Any], fits: bool = False
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return parameters as a method takes them, and as a result records them.

    `recipe` becomes a `BlurRecipe`, or a `BlurLaw` if it has `sigmas`. For a recipe in a file, the
    file's content is recorded, so that the result can be run again without it.

    Parameters
    ----------
    given : mapping
        Parameters by name. `recipe` may be a recipe's name, the fields of a recipe or a law, a TOML
        file of them, a `BlurRecipe` or a `BlurLaw`.
    fits : bool
        Whether the method has a ``fit``. Its recipe may then be None, which leaves the blur to the
        fit.

    Raises
    ------
    UnknownNameError
        If no blur recipe has that name.
    MethodError
        If fields of a recipe are unknown, missing or wrong, or its file cannot be read; or if a
        number is not finite or a text is not UTF-8, which no result can keep.

    Examples
    --------
    >>> taken, recorded = read_parameters({"recipe": {"sigma_min": 0.2, "sigma_step": 0.006}})
    >>> taken["recipe"].levels, recorded
    (256, {'recipe': {'sigma_min': 0.2, 'sigma_step': 0.006}})
    """
    given = {n: v.item() if isinstance(v, np.generic) else v for n, v in given.items()}
    # Recipes are left out because they report their own problems.
    _require_kept({name: value for name, value in given.items() if name != "recipe"})
    taken = dict(given)
    recorded = {name: _plain(value) for name, value in given.items()}
    withheld = fits and given.get("recipe") is None
    if "recipe" in given and not withheld:
        recipe: Any = given["recipe"]
        where = "parameter recipe"
        recipe = str(recipe) if isinstance(recipe, Path) else recipe
        if isinstance(recipe, str) and recipe not in RECIPES:
            recipe, where = read_fields(recipe), recipe
        taken["recipe"] = _recipe_of(recipe, where)
        recorded["recipe"] = _plain(recipe)
    return taken, recorded


def files_sha256(parameters: Mapping[str, Any]) -> dict[str, str]:
    """Return the SHA-256 of each file or folder that parameters name, by the parameter's name.

    Parameters
    ----------
    parameters : mapping
        Parameters by name; paths within lists and mappings count too, as ``NAME.0`` and
        ``NAME.KEY``. A folder's hash covers its files' names and contents.

    Raises
    ------
    MethodError
        If one of them cannot be read, or is a folder with more than 10,000 files or 20 GB.

    Examples
    --------
    >>> files_sha256({"window": 9, "weights": "no/such/file"})
    {}
    """
    return {
        name: _digest(Path(value))
        for name, value in _leaves(parameters)
        if isinstance(value, str) and (os.path.isfile(value) or os.path.isdir(value))
    }


def _recipe_of(given: Any, where: str) -> BlurRecipe | BlurLaw:
    if isinstance(given, BlurLaw):
        return given
    if not isinstance(given, str | Mapping | BlurRecipe):
        known = f"{', '.join(RECIPES)}, fields such as sigma_min, or FILE.toml"
        raise errors.MethodError(f"not a blur recipe: {given!r}", where=where, expected=known)
    try:
        is_law = isinstance(given, Mapping) and SIGMAS in given
        return law_of_fields(given) if is_law else find_recipe(given)  # type: ignore[arg-type]
    except errors.UnknownNameError:
        raise
    except errors.DfdbenchError as error:
        raise errors.MethodError.of(
            replace(problem, where=f"{where}: {problem.where}".removesuffix(": "))
            for problem in error.problems
        ) from error


def read_fields(file: str | Path) -> dict[str, Any]:
    """Return the fields of a blur from a TOML file.

    Raises
    ------
    UnknownNameError
        If it does not end in ``.toml``, and so is taken for a recipe's name.
    MethodError
        If it cannot be read.
    """
    path = Path(file)
    if path.suffix != ".toml":
        own = "A recipe of your own: its fields, or FILE.toml"
        raise errors.unknown_name("blur recipe", str(file), RECIPES, own)
    try:
        return parse_toml(read_text(path))
    except (OSError, ValueError) as error:
        what = f"cannot read the blur recipe: {errors.reason_of(error)}"
        fix = "name a TOML file of a recipe, law or lens"
        raise errors.MethodError(what, where=str(file), fix=fix) from error


def _plain(value: Any) -> Any:
    # Make it fit for JSON, in which runs and results keep it.
    if isinstance(value, BlurRecipe | BlurLaw):
        return value.as_dict()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    return value


def _require_kept(parameters: Mapping[str, Any]) -> None:
    problems = []
    for name, value in _leaves(parameters):
        text, where = errors.writable(str(value)), f"parameter {errors.writable(name)}"
        number = isinstance(value, float | np.floating)
        if (number and not math.isfinite(value)) or (isinstance(value, str) and text != value):
            what = "a parameter that no result can keep"
            expected = "finite numbers, and text in UTF-8"
            problems.append(errors.Problem(what, where=where, expected=expected, got=text[:80]))
    errors.MethodError.raise_if(problems)


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping | list):
        parts = value.items() if isinstance(value, Mapping) else enumerate(value)
        for key, part in parts:
            yield from _leaves(part, f"{name}.{key}" if name else str(key))
    else:
        yield name, value


def _digest(path: Path) -> str:
    try:
        return sha256_of(path) if path.is_file() else _of_folder(path)
    except OSError as error:
        what = f"cannot read what a parameter names, to hash it: {errors.reason_of(error)}"
        raise errors.MethodError(what, where=str(error.filename or path)) from error


def _of_folder(folder: Path) -> str:
    names = (Path(place, name) for place, _, found in os.walk(folder) for name in found)
    # Count all of them before looking at any.
    some = list(itertools.islice(names, _MOST_FILES + 1))
    files = [path for path in some if path.is_file()] if len(some) <= _MOST_FILES else []
    if len(some) > _MOST_FILES or sum(path.stat().st_size for path in files) > _MOST_BYTES:
        most = f"{_MOST_FILES:,} files or {_MOST_BYTES / 1e9:.0f} GB"
        what = f"a parameter names a folder that is too large to hash, above {most}"
        fix = "name the folder or the file that the method reads"
        raise errors.MethodError(what, where=str(folder), fix=fix)
    lines = sorted(f"{sha256_of(path)}  {path.relative_to(folder).as_posix()}\n" for path in files)
    return hashlib.sha256("".join(lines).encode("utf-8", "surrogateescape")).hexdigest()
