"""Import what an entry names, and explain failures."""

import ast
import hashlib
import importlib
import importlib.util
import os
import sys
import sysconfig
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any

from dfdbench.errors import MethodError, unknown_name
from dfdbench.system.packages import absent, extra_of

#: The suffix of a network's file that a description beside it makes a method.
ONNX = ".onnx"
_NOTHING = object()
# The most characters of an exception's text, which a result keeps for every pair.
_MOST_TEXT = 500


def import_entry(entry: str) -> tuple[Any, ModuleType]:
    """Return what an entry names, and the module that it is defined in.

    Raises
    ------
    MethodError
        If the module cannot be imported, or has no such attribute.
    """
    place, _, attribute = entry.rpartition(":")
    if not place or not attribute:
        what = "not a method's name: give module:function or path/to/file.py:function"
        raise MethodError(what, where=entry)
    if place.endswith(ONNX):
        module = _import_module("dfdbench.methods.onnx_model")
        return module.read_model(Path(place)), module
    module = _import_file(Path(place)) if place.endswith(".py") else _import_module(place)
    found: Any = module
    for part in attribute.split("."):
        below = attribute_of(found, part, entry, _NOTHING)
        if below is _NOTHING:
            names = [key for key, value in vars(module).items() if callable(value)]
            public = [key for key in names if not key.startswith("_")] or ["nothing to call"]
            near = unknown_name("attribute", part, public).problems[0]
            what = f"{place} has no {part}"
            raise MethodError(what, where=entry, expected=near.expected, fix=near.fix)
        found = below
    return found, module


def attribute_of(target: Any, name: str, entry: str, default: Any = None) -> Any:
    """Return an attribute of a user's code; if that code raises, raise a MethodError.

    Parameters
    ----------
    target : object
        A module, class, function or object.
    name : str
        The attribute's name.
    entry : str
        The target's name in errors.
    default : object
        What to return if there is no such attribute.

    Raises
    ------
    MethodError
        If reading it raises.

    Examples
    --------
    >>> attribute_of(str, "lower", "builtins:str"), attribute_of(str, "fit", "builtins:str")
    (<method 'lower' of 'str' objects>, None)
    """
    try:
        return getattr(target, name, default)
    except Exception as error:
        what = "an attribute of the method cannot be read"
        raise error_of(what, f"{entry}: {name}", error) from error


def near_entry(name: str) -> str:
    """Return the entry that a name without a colon seems to mean, or an empty string.

    The file is searched for from the working directory, and parsed but not imported.

    Parameters
    ----------
    name : str
        Such as ``mymodule.predict``, ``mymodule`` or ``folder/mymodule.py``.

    Examples
    --------
    >>> near_entry("nosuchmodule.predict")
    ''
    """
    is_file = name.endswith(".py")
    module, _, attribute = name.rpartition(".")
    for place, asked in ((name, ""),) if is_file else ((name, ""), (module, attribute)):
        file = Path(place if is_file else place.replace(".", "/") + ".py")
        try:
            body = ast.parse(file.read_bytes()).body
        except (OSError, SyntaxError, ValueError):
            continue
        kinds = (ast.FunctionDef, ast.ClassDef)
        there = [part.name for part in body if isinstance(part, kinds) and part.name[0] != "_"]
        for wanted in [asked] if asked else ["predict", *there]:
            if wanted in there:
                return f"{place}:{wanted}"
    return ""


def _import_module(name: str) -> ModuleType:
    # Find a module in the working directory, as `python -m` would. Our own modules do not need
    # this, and must not import anything from there.
    own = name.split(".")[0] == "dfdbench"
    if not own and "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    try:
        return importlib.import_module(name)
    except (Exception, SystemExit) as error:
        lacking = error.name if isinstance(error, ModuleNotFoundError) else None
        if extra := extra_of(lacking):
            raise MethodError.of(absent(str(lacking), extra)) from error
        if lacking and (name == lacking or name.startswith(lacking + ".")):
            what = f"no module named {lacking}, neither installed nor in {Path.cwd()}"
            fix = "run from the module's folder, install it, or name its file: file.py:name"
            raise MethodError(what, where=name, fix=fix) from error
        raise error_of("the module cannot be imported", name, error) from error


def _import_file(path: Path) -> ModuleType:
    if not path.is_file():
        fix = f"name it from {Path.cwd()}, or in full"
        raise MethodError("no such file", where=str(path), fix=fix)
    name = f"dfdbench_method_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:12]}"
    specification = importlib.util.spec_from_file_location(name, path)
    if specification is None or specification.loader is None:
        raise MethodError("not a Python file", where=str(path))
    module = importlib.util.module_from_spec(specification)
    # Its own folder comes first, as when the file is run; dataclasses and pickle need the entry.
    sys.path.insert(0, str(path.resolve().parent))
    sys.modules[name] = module
    try:
        specification.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise error_of("the file cannot be imported", str(path), error) from error
    finally:
        sys.path.remove(str(path.resolve().parent))
    return module


def describe(error: BaseException) -> str:
    """Return an exception's type and text on one line.

    Examples
    --------
    >>> describe(ValueError("no"))
    'ValueError: no'
    """
    text = str(error).strip()
    if len(text) > _MOST_TEXT:
        text = f"{text[:_MOST_TEXT]}… ({len(text):,} characters)"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def error_of(what: str, where: str, error: BaseException) -> MethodError:
    """Return the error for an exception that a user's own code raised, with the place."""
    # A syntax error's own text names its file and line.
    raised = "" if isinstance(error, SyntaxError) else where_raised(error)
    return MethodError(what, where=where, got=describe(error) + raised)


def where_raised(error: BaseException) -> str:
    """Return where in a user's own code an exception arose, in brackets, or an empty string.

    It is the last frame that belongs neither to dfdbench nor to Python and its libraries or, if
    there is none, the first outside dfdbench. Results keep this, so it has only the file's name.

    Examples
    --------
    >>> where_raised(ValueError("never raised"))
    ''
    """
    ours = str(Path(__file__).parents[1]) + os.sep
    # Without source lines, for which files would be opened.
    walked = traceback.walk_tb(error.__traceback__)
    passed = traceback.StackSummary.extract(walked, lookup_lines=False)
    frames = [frame for frame in passed if not frame.filename.startswith(ours)]
    own = [frame for frame in frames if not _is_library(frame.filename)]
    for frame in own[-1:] or frames[:1]:
        return f" ({Path(frame.filename).name}:{frame.lineno} in {frame.name})"
    return ""


def _is_library(file: str) -> bool:
    if {"site-packages", "dist-packages"} & set(Path(file).parts):
        return True
    return file.startswith(("<frozen ", sysconfig.get_path("stdlib") + os.sep))
