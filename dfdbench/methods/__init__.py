"""Find a method by name, and call it so that one bad pair cannot spoil a run."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import importlib.util
import inspect
import io
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import MethodError, Problem, unknown_name
from dfdbench.methods.isolation import process_kept
from dfdbench.methods.parameters import files_sha256, read_parameters
from dfdbench.results.record import LARGEST_NUMBER
from dfdbench.system.extras import absent, extra_of

Image = NDArray[np.uint8]
Predict = Callable[[Image, Image], Any]

ENTRY_POINT_GROUP = "dfdbench.methods"
_BUILT_IN = {
    "constant": "dfdbench.methods.baselines:Constant",
    "dfd-net": "dfdbench.methods.learned:DfDNetMethod",
    "graph-cuts": "dfdbench.methods.graph_cuts:GraphCuts",
    "graph-cuts-rounded": "dfdbench.methods.rounded_graph_cuts:RoundedGraphCuts",
    "local": "dfdbench.methods.baselines:Local",
    "u-net": "dfdbench.methods.learned:UNetMethod",
}
# A level this far out of 0..255 is rounding, not a mistake.
_ROUNDING = 1e-3


@dataclass(frozen=True)
class Method:
    """A method ready to be run.

    Parameters
    ----------
    name : str
        As the user gave it.
    entry : str
        ``module:attribute`` or ``file.py:attribute``.
    predict : callable
        ``predict(infocus, defocus) -> depth``.
    parameters : dict
        What the user set, fit for JSON.
    uses : tuple of str
        Which facts of the data set it was handed, of those offered to `load_method`.
    source_sha256 : str or None
        Of the file it is defined in.
    """

    name: str
    entry: str
    predict: Predict
    parameters: dict[str, Any] = field(default_factory=dict)
    uses: tuple[str, ...] = ()
    source_sha256: str | None = None

    @property
    def warm_up(self) -> Predict | None:
        """What to call once, untimed, before the first pair."""
        return getattr(self.predict, "warm_up", None)

    @property
    def trained_on(self) -> str | None:
        """The data it was trained on, where it says so."""
        trained_on = getattr(self.predict, "trained_on", None)
        return str(trained_on) if trained_on else None

    @property
    def paper(self) -> str | None:
        """The publication it comes from, where it says so."""
        paper = getattr(self.predict, "paper", None)
        return str(paper) if paper else None

    @property
    def weights_sha256(self) -> str | None:
        """The SHA-256 of the weights it was given, where it says so."""
        digest = getattr(self.predict, "weights_sha256", None)
        return str(digest) if digest else None

    @functools.cached_property
    def files_sha256(self) -> dict[str, str]:
        """The SHA-256 of the files and folders that parameters name."""
        return files_sha256(self.parameters)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a result should say of how it is used here."""
        return tuple(str(text) for text in getattr(self.predict, "warnings", ()))


@dataclass(frozen=True)
class Prediction:
    """What one call gave: a depth map, or the reason why there is none.

    Parameters
    ----------
    depth : ndarray of float32, shape (y, x), or None
        Depth levels.
    seconds : float
        Wall-clock time of the call.
    error : str
        Why there is no depth; empty where there is one.
    printed : str
        What the method wrote to standard output.
    numbers : dict of str to float
        What the method said of its answer besides, an energy for example.
    """

    depth: NDArray[np.float32] | None
    seconds: float
    error: str = ""
    printed: str = ""
    numbers: dict[str, float] = field(default_factory=dict)


def registered_methods() -> dict[str, str]:
    """Return the registered methods: the built-in ones and those that packages offer.

    Returns
    -------
    dict of str to str
        Entry (``module:attribute``) by name. A built-in name cannot be taken by a package.

    Examples
    --------
    >>> registered_methods()["local"]
    'dfdbench.methods.baselines:Local'
    """
    offered = {point.name: point.value for point in entry_points(group=ENTRY_POINT_GROUP)}
    return {**offered, **_BUILT_IN}


def built_in_methods() -> dict[str, str]:
    """Return the methods of dfdbench itself: entry (``module:attribute``) by name.

    Examples
    --------
    >>> "local" in built_in_methods()
    True
    """
    return dict(_BUILT_IN)


def load(name: str, **params: Any) -> Predict:
    """Return a method's callable.

    Parameters
    ----------
    name : str
        A registered name, ``module:attribute`` or ``path/to/file.py:attribute``.
    **params
        Handed to a class when it is constructed, or to a function at each call. `recipe` may be
        a blur recipe's name, its fields as a mapping, a TOML file of them, or a `BlurRecipe`.

    Returns
    -------
    callable
        ``predict(infocus, defocus)``, of two RGB images of uint8, shape (y, x, 3); it returns
        depth levels 0 to 255, shape (y, x).

    Raises
    ------
    MethodError
        Where it cannot be imported or does not take these parameters.
    UnknownNameError
        Where no method of that name is registered.

    Examples
    --------
    >>> predict = load("constant", training_mean=80.0)
    >>> image = np.zeros((2, 3, 3), np.uint8)
    >>> predict(image, image).tolist()
    [[80.0, 80.0, 80.0], [80.0, 80.0, 80.0]]
    """
    return load_method(name, params, {}).predict


def load_method(
    name: str, parameters: Mapping[str, Any], offers: Mapping[str, Callable[[], Any]]
) -> Method:
    """Find a method, construct it where it is a class, and say where it came from.

    Parameters
    ----------
    name : str
        As for `load`.
    parameters : mapping
        What the user set.
    offers : mapping of str to callable
        Facts of the data set by parameter name (``recipe``, ``training_mean``), worked out only
        for a class that has such a parameter which the user left open.

    Raises
    ------
    MethodError, UnknownNameError
        As for `load`.
    """
    entry = name
    if ":" not in name:
        registered = registered_methods()
        if name not in registered:
            raise unknown_name(
                "method", name, registered, "A method of your own: module:attribute or file.py:name"
            )
        entry = registered[name]
    target, source = _import(entry)
    given, recorded = read_parameters(parameters)
    if inspect.isclass(target):
        accepted = _parameters(target)
        uses = tuple(key for key in offers if key in accepted and key not in given)
        arguments = given | {key: offers[key]() for key in uses}
        _check_parameters(entry, target, arguments)
        try:
            predict = target(**arguments)
        except MethodError:
            raise
        except (Exception, SystemExit) as error:
            raise MethodError(
                "the method cannot be constructed", where=entry, got=_describe(error)
            ) from error
    else:
        uses = ()
        predict = target
        if given:
            _check_parameters(entry, target, {"infocus": None, "defocus": None} | given)
            predict = functools.partial(target, **given)
    if not callable(predict):
        raise MethodError(
            "not a method",
            where=entry,
            expected="something to call as predict(infocus, defocus)",
            got=type(predict).__name__,
        )
    return Method(name, entry, predict, recorded, uses, source)


def entry_of(target: Callable[..., Any]) -> str:
    """Return ``module:attribute`` of a function or class, under which it can be imported.

    Raises
    ------
    MethodError
        Where it is not to be had under a name, or what it does could change unnoticed: a lambda,
        a function within another, an object, anything typed into an interpreter.

    Examples
    --------
    >>> entry_of(load)
    'dfdbench.methods:load'
    """
    place, name = getattr(target, "__module__", ""), getattr(target, "__qualname__", "")
    module = sys.modules.get(place)
    if not getattr(module, "__file__", None) or getattr(module, name, None) is not target:
        raise MethodError(
            what="the method has no name under which it could be found again",
            where=name or type(target).__name__,
            expected="a name, or a function or class at the top of a module's file",
            got=repr(target)[:80],
            fix="put it into a file and pass 'file.py:name'; an object's class: its parameters "
            "go beside it",
        )
    return f"{place}:{name}"


def call(predict: Predict, infocus: Image, defocus: Image) -> Prediction:
    """Call a method on one pair and check what it returns; nothing it does raises.

    Parameters
    ----------
    predict : callable
        The method.
    infocus, defocus : ndarray of uint8, shape (y, x, 3)
        RGB; the method gets copies.

    Notes
    -----
    Numbers that a result is to keep, an energy for example, are read after the call from the
    method's attribute ``numbers``, a mapping of names to what the last call came to.

    What the method changes of the process is put back: see `process_kept`.

    Examples
    --------
    >>> image = np.zeros((2, 2, 3), np.uint8)
    >>> call(lambda infocus, defocus: [[1, 2], [3, 4]], image, image).depth.tolist()
    [[1.0, 2.0], [3.0, 4.0]]
    >>> call(lambda infocus, defocus: infocus, image, image).error
    'returned shape (2, 2, 3); expected (2, 2), one depth level a pixel'
    """
    copies = infocus.copy(), defocus.copy()
    printed = io.StringIO()
    depth, error = None, ""
    numbers: dict[str, float] = {}
    begin = time.perf_counter()
    try:
        with process_kept(), contextlib.redirect_stdout(printed):
            begin = time.perf_counter()
            returned = predict(*copies)
            seconds = time.perf_counter() - begin
            numbers = _finite_numbers(getattr(predict, "numbers", None))
    except (Exception, SystemExit) as raised:
        error = f"raised {_describe(raised)}"
        seconds = time.perf_counter() - begin
    else:
        depth, error = check_depth(returned, infocus.shape[:2])
    return Prediction(depth, seconds, error, printed.getvalue(), numbers)


def check_depth(returned: Any, shape: tuple[int, ...]) -> tuple[NDArray[np.float32] | None, str]:
    """Return a method's answer as float32 levels, or None and what is wrong with it.

    Examples
    --------
    >>> check_depth(np.full((2, 2), 300), (2, 2))
    (None, 'returned levels from 300 to 300; expected 0 to 255')
    """
    if isinstance(returned, tuple) and any(isinstance(part, Mapping) for part in returned):
        return None, (
            "returned a depth map and numbers; expected the depth map alone: "
            "keep numbers in the method's attribute `numbers`, from which a result takes them"
        )
    try:
        array = np.asarray(returned)
    except Exception as error:
        return None, f"returned a {type(returned).__name__} that is no array: {_describe(error)}"
    if array.dtype.kind not in "uif":
        return None, f"returned {array.dtype} values; expected real numbers"
    if array.shape != shape:
        return None, f"returned shape {array.shape}; expected {shape}, one depth level a pixel"
    if not np.isfinite(array).all():
        bad = int(array.size - np.isfinite(array).sum())
        return None, f"returned NaN or infinity in {bad} of {array.size} pixels"
    low, high = array.min(), array.max()
    if low < -_ROUNDING or high > 255 + _ROUNDING:
        return None, f"returned levels from {low:g} to {high:g}; expected 0 to 255"
    return np.clip(array.astype(np.float32), 0, 255), ""


def _finite_numbers(given: Any) -> dict[str, float]:
    # Strings, infinities and the like are no numbers that a result could average: left out.
    numbers = {}
    for name, value in given.items() if isinstance(given, Mapping) else ():
        numeric = isinstance(value, (int, float, np.integer, np.floating))
        if numeric and abs(value) <= LARGEST_NUMBER:
            numbers[str(name)] = float(value)
    return numbers


def _import(entry: str) -> tuple[Any, str | None]:
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
            "the module cannot be imported", where=name, got=_describe(error)
        ) from error
    except (Exception, SystemExit) as error:
        raise MethodError(
            "the module cannot be imported", where=name, got=_describe(error)
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
            "the file cannot be imported", where=str(path), got=_describe(error)
        ) from error
    finally:
        sys.path.remove(str(path.resolve().parent))
    return module


def _parameters(target: Callable[..., Any]) -> set[str]:
    try:
        return set(inspect.signature(target).parameters)
    except (TypeError, ValueError):
        return set()


def _check_parameters(entry: str, target: Callable[..., Any], arguments: dict[str, Any]) -> None:
    try:
        signature = inspect.signature(target)
    except (TypeError, ValueError):
        return
    kinds = {parameter.kind for parameter in signature.parameters.values()}
    names = [name for name in signature.parameters if name not in ("infocus", "defocus")]
    unknown = [name for name in arguments if name not in signature.parameters]
    if unknown and inspect.Parameter.VAR_KEYWORD not in kinds:
        unknown = [name for name in unknown if name not in ("infocus", "defocus")]
        if unknown:
            raise MethodError.of(
                [
                    Problem(
                        "unknown parameter",
                        where=entry,
                        expected="one of: " + ", ".join(names) if names else "no parameters",
                        got=name,
                    )
                    for name in unknown
                ]
            )
    empty = inspect.Parameter.empty
    missing = [
        name
        for name, parameter in signature.parameters.items()
        if parameter.default is empty
        and parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
        and name not in arguments
    ]
    if inspect.isclass(target) and missing:
        raise MethodError.of(
            [
                Problem(
                    "parameter is needed", where=entry, expected=name, fix=f"--param {name}=VALUE"
                )
                for name in missing
            ]
        )


def _describe(error: BaseException) -> str:
    text = str(error).strip()
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
