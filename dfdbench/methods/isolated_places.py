"""Which files and modules the process of an isolated method is to find, by what names them."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Mapping, Sequence
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from dfdbench.methods.registry import registered_methods


def named_paths(value: Any) -> list[str]:
    """Return the texts of parameters that name a file or folder by more than a plain word."""
    if isinstance(value, Mapping):
        return [text for part in value.values() for text in named_paths(part)]
    if isinstance(value, list | tuple):
        return [text for part in value for text in named_paths(part)]
    named = isinstance(value, str | Path) and len(str(value)) < 4096
    # A word, such as a recipe's name, may be a folder's by chance.
    plain = str(value).replace("-", "").replace("_", "").isalnum()
    return [str(value)] if named and not plain and os.path.exists(value) else []


def renamed(value: Any, names: Mapping[str, str]) -> Any:
    """Return parameters with some of their texts put in other words.

    Examples
    --------
    >>> renamed({"file": "a/b.txt", "size": [3]}, {"a/b.txt": "/here/a/b.txt"})
    {'file': '/here/a/b.txt', 'size': [3]}
    """
    if isinstance(value, Mapping):
        return {key: renamed(part, names) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [renamed(part, names) for part in value]
    if isinstance(value, str | Path):
        return names.get(str(value), value)
    return value


def python_path(name: str) -> list[str]:
    """Return where a Python elsewhere finds modules as this one does, for a method of that name."""
    here = str(Path.cwd())
    paths = [path or here for path in sys.path]
    # As `dfdbench.methods.importing` has it: a module beside the user is found.
    beside = ":" in name and not name.rpartition(":")[0].endswith(".py")
    return [here, *paths] if beside and here not in paths else paths


def places_of(name: str, parameters: Mapping[str, Any], path: Sequence[str]) -> list[Path]:
    """Return what a method reads of its own: its module's folder, and what its parameters name."""
    place = registered_methods().get(name, name).rpartition(":")[0]
    own = Path(place).parent if place.endswith(".py") else _package_of(place, path)
    return [*map(Path, named_paths(parameters)), *([own] if own else [])]


def _package_of(module: str, paths: Sequence[str]) -> Path | None:
    top = module.partition(".")[0]
    with contextlib.suppress(ImportError, ValueError):
        found = PathFinder.find_spec(top, list(paths)) or find_spec(top)
        if found and found.origin:
            return Path(found.origin).parent
    return None
