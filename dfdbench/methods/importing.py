"""Import what an entry names, and say what is wrong where that fails."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from dfdbench.errors import MethodError, unknown_name
from dfdbench.system.extras import absent, extra_of


def import_entry(entry: str) -> tuple[Any, str | None]:
    """Return what an entry names, and the SHA-256 of the file that it is defined in.

    Raises
    ------
    MethodError
        Where it cannot be imported, or has no such attribute.
    """
    place, _, attribute = entry.rpartition(":")
    if not place or not attribute:
        raise MethodError(
            "not a method's name",
            where=entry,
            expected="module:attribute or path/to/file.py:attribute",
        )
    module = _import_file(Path(place)) if place.endswith(".py") else _import_module(place)
    found: Any = module
    for part in attribute.split("."):
        if not hasattr(found, part):
            names = [key for key, value in vars(module).items() if callable(value)]
            public = [key for key in names if not key.startswith("_")] or ["nothing to call"]
            near = unknown_name("attribute", part, public).problems[0]
            raise MethodError(
                f"{place} has no {part}",
                where=entry,
                expected=near.expected,
                got=part,
                fix=near.fix,
            )
        found = getattr(found, part)
    file = getattr(module, "__file__", None)
    source = hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else None
    return found, source


def _import_module(name: str) -> ModuleType:
    # The command line runs from anywhere: a module beside the user is found as `python -m` would.
    # For our own there is no need, and what they import must not be found there.
    own = name.split(".")[0] == "dfdbench"
    if not own and "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        extra = extra_of(error.name)
        if extra:
            raise MethodError.of(absent(str(error.name), extra)) from error
        if error.name and (name == error.name or name.startswith(error.name + ".")):
            raise MethodError(
                f"no module named {error.name}",
                where=name,
                got=f"looked in {Path.cwd()} too",
                fix="run from the module's folder, install it, or name its file: file.py:name",
            ) from error
        raise MethodError(
            "the module cannot be imported", where=name, got=describe(error)
        ) from error
    except (Exception, SystemExit) as error:
        raise MethodError(
            "the module cannot be imported", where=name, got=describe(error)
        ) from error


def _import_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise MethodError("no such file", where=str(path), got=f"looked in {Path.cwd()}")
    name = f"dfdbench_method_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:12]}"
    specification = importlib.util.spec_from_file_location(name, path)
    if specification is None or specification.loader is None:
        raise MethodError("not a Python file", where=str(path))
    module = importlib.util.module_from_spec(specification)
    # Its own folder comes first, as when the file is run; dataclasses and pickle want the entry.
    sys.path.insert(0, str(path.resolve().parent))
    sys.modules[name] = module
    try:
        specification.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise MethodError(
            "the file cannot be imported", where=str(path), got=describe(error)
        ) from error
    finally:
        sys.path.remove(str(path.resolve().parent))
    return module


def describe(error: BaseException) -> str:
    """Return an exception's kind and text on one line.

    Examples
    --------
    >>> describe(ValueError("no"))
    'ValueError: no'
    """
    text = str(error).strip()
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
