"""Find a method by its name and make it ready to run."""

from __future__ import annotations

import functools
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from importlib.resources import files
from inspect import Parameter, signature
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from dfdbench.errors import MethodError, Problem, unknown_name
from dfdbench.methods.importing import ONNX, error_of, import_entry, near_entry
from dfdbench.system.packages import offered_as

if TYPE_CHECKING:
    from dfdbench.methods.method import Method, Predict
    from dfdbench.methods.sources import Sources

#: Facts of a data set by parameter name, computed on demand.
Facts = Mapping[str, Callable[[], Any]]


def _parameters_of(target: Callable[..., Any]) -> Mapping[str, Parameter] | None:
    try:
        return signature(target).parameters
    except (TypeError, ValueError):  # some that are written in C have none
        return None


def check_parameters(entry: str, target: Callable[..., Any], arguments: Mapping[str, Any]) -> None:
    """Raise unless a callable takes these arguments, and a class needs no others.

    Raises
    ------
    MethodError
        If a parameter is unknown, missing, or text where a number is declared; it names each one.
    """
    known = _parameters_of(target)
    if known is None:
        return
    names = list(known)
    if not isinstance(target, type):
        # A function's first parameters are the images.
        by_place = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
        images = [name for name in names if known[name].kind in by_place]
        names = [name for name in names if name not in images[: 1 if "stack" in images[:1] else 2]]
    if all(parameter.kind is not parameter.VAR_KEYWORD for parameter in known.values()):
        MethodError.raise_if(
            _unknown_parameter(name, entry, names) for name in arguments if name not in names
        )
    MethodError.raise_if(_texts(entry, known, arguments))
    if isinstance(target, type):
        MethodError.raise_if(
            Problem(
                "parameter is needed",
                where=entry,
                expected=name,
                fix=f"give {name}=VALUE, or --param {name}=VALUE",
            )
            for name, parameter in known.items()
            if parameter.default is parameter.empty
            and parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
            and name not in arguments
        )


def _texts(
    entry: str, known: Mapping[str, Parameter], arguments: Mapping[str, Any]
) -> Iterator[Problem]:
    """Yield a problem for each text that should be a number; our own methods check the rest."""
    for name, value in arguments.items():
        kind = known[name].annotation if name in known else ""
        kind = str(getattr(kind, "__name__", kind))
        is_text = isinstance(value, str) and kind in ("bool", "float", "int")
        if is_text and not entry.startswith("dfdbench."):
            yield Problem(f"parameter {name} is text", where=entry, expected=kind, got=value)


def _unknown_parameter(name: str, entry: str, known: list[str]) -> Problem:
    if name in _OPTIONS:
        what, option = _OPTIONS[name]
        fix = f"leave out {option} (--param {name}=...)"
        return Problem(f"this method takes no {what}", where=entry, fix=fix)
    if not known:
        return Problem("unknown parameter", where=entry, expected="no parameters", got=name)
    return replace(unknown_name("parameter", name, known).problems[0], where=entry)


# Parameters that have an option of their own in the command `predict`.
_OPTIONS = {"recipe": ("lens or blur recipe", "--lens"), "weights": ("weights", "--weights")}
ENTRY_POINT_GROUP = "dfdbench.methods"


@functools.cache
def _built_in() -> dict[str, dict[str, str]]:
    """Return entry and description of each of dfdbench's own methods, by name."""
    source = files("dfdbench.methods").joinpath("methods.toml")
    return tomllib.loads(source.read_text(encoding="utf-8"))


def method_words() -> dict[str, str]:
    """Return a short description of each registered method, by name.

    Examples
    --------
    >>> method_words()["local"]
    'the depth whose blur fits best around each pixel'
    """
    words = {name: about["words"] for name, about in _built_in().items()}
    return {name: words.get(name, "of another package") for name in registered_methods()}


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
    offered = {name: point.value for name, point in offered_as(ENTRY_POINT_GROUP).items()}
    return offered | built_in_methods()


def built_in_methods() -> dict[str, str]:
    """Return the methods of dfdbench itself: entry (``module:attribute``) by name.

    Examples
    --------
    >>> "local" in built_in_methods()
    True
    """
    return {name: about["entry"] for name, about in _built_in().items()}


def load(name: str, **params: Any) -> Predict:
    """Return a method's callable.

    Parameters
    ----------
    name : str
        A registered name, ``path/to/file.py:function``, ``module:function`` or
        ``path/to/model.onnx``.
    **params
        Passed to a class when it is constructed, or to a function at each call. `recipe` may be
        a blur recipe's name, its fields as a mapping, a TOML file of them, or a `BlurRecipe`.

    Returns
    -------
    callable
        ``predict(infocus, defocus)``, which takes two RGB images, uint8 of shape (y, x, 3), and
        returns depth levels 0 to 255, shape (y, x).

    Raises
    ------
    MethodError
        If it cannot be imported or does not take these parameters.
    UnknownNameError
        If no method of that name is registered.

    Examples
    --------
    >>> import numpy as np
    >>> predict = load("constant", training_mean=80.0)
    >>> image = np.zeros((2, 3, 3), np.uint8)
    >>> predict(image, image).tolist()
    [[80.0, 80.0, 80.0], [80.0, 80.0, 80.0]]
    """
    return load_method(name, params, {}).predict


def load_method(
    name: str | Callable[..., Any],
    parameters: Mapping[str, Any],
    offers: Facts,
    for_fits: Facts = MappingProxyType({}),
) -> Method:
    """Find a method, construct it if it is a class, and note where it came from.

    A function in a notebook, a lambda or an object may change unnoticed. So its source has no hash,
    its runs cannot be resumed, and no other process can load it.

    Parameters
    ----------
    name : str, callable or Method
        As for `load`, or the function, class or object itself. A method that was loaded before is
        loaded again with its parameters, and has to be fitted again.
    parameters : mapping
        The parameters that the user set.
    offers : mapping of str to callable
        Facts of the data set by parameter name (``recipe``, ``training_mean``), computed only for
        a class that has such a parameter and only if the user did not set it.
    for_fits : mapping of str to callable, optional
        Facts that replace the offers for a class that has a ``fit``. If one gives None, the fact
        does not exist and the fit can measure it; it is then not among the method's uses.

    Raises
    ------
    MethodError, UnknownNameError
        As for `load`.
    """
    # Imported before files are watched, because pydantic, which recipes use, first reads lists of
    # packages, as does a search by name; and not at the top, so that listing names needs no numpy.
    from dfdbench.methods.calling import WithArguments, as_method
    from dfdbench.methods.method import Method
    from dfdbench.methods.parameters import read_parameters
    from dfdbench.methods.sources import Sources

    if isinstance(name, Method):
        parameters, name = {**name.parameters, **parameters}, _name_of(name)
    shown, entry, target = _found(name)
    sources = Sources()
    with sources.watch():
        if target is None:
            shown, target = _imported(shown, entry, sources)
            sources.note_values(target)
        fits = hasattr(target, "fit")
        given, recorded = read_parameters(parameters, fits)
        offered = {**offers, **for_fits} if fits else offers
        uses: tuple[str, ...] = ()
        if isinstance(target, type):
            accepted = _parameters_of(target) or {}
            asked = [key for key in offered if key in accepted and key not in given]
            facts = {key: offered[key]() for key in asked}
            uses = tuple(key for key in asked if facts[key] is not None)
            check_parameters(entry, target, given | facts)
            predict = as_method(_constructed(entry, target, given | facts))
        else:
            predict = as_method(target)
            if given:
                check_parameters(entry, target, given)
                predict = WithArguments(predict, given)
        if not callable(predict):
            kind = type(predict).__name__
            what = f"not a method: {'an' if kind[0] in 'aeiou' else 'a'} {kind}"
            expected = "something to call as predict(infocus, defocus)"
            raise MethodError(what, where=entry, expected=expected)
        method = Method(shown, entry, predict, recorded, uses, sources=sources)
        # Fail now, not after the hours of a run.
        method.require_readable()
    return method


def _name_of(method: Method) -> str:
    if method.source_sha256 is None:
        what = "the method was loaded from an object, and no name leads there"
        raise MethodError(what, where=method.name, fix="give the object itself")
    return method.name if method.name in registered_methods() else method.entry


def _found(name: str | Callable[..., Any]) -> tuple[str, str, Any]:
    """Return a method's name, its entry, and the method itself if no entry leads to it."""
    if name is None:
        raise MethodError("no method is named", fix="give its name, or something to call")
    if not isinstance(name, str):
        try:
            name = entry_of(name)
        except MethodError:
            kind: Any = name if hasattr(name, "__qualname__") else type(name)
            return kind.__qualname__, f"{kind.__module__}:{kind.__qualname__}", name
    entry = find_entry(name)
    if not entry.isprintable():
        # No result could name it.
        what = "the method's place holds characters that cannot be printed"
        raise MethodError(what, where=entry, fix="rename the file or its folder")
    return name, entry, None


def _imported(name: str, entry: str, sources: Sources) -> tuple[str, Any]:
    """Return a method's name and what its entry names, and note where that is defined."""
    target, module = import_entry(entry)
    place = Path(entry.rpartition(":")[0])
    is_onnx = place.suffix == ONNX
    sources.begin_at(module, place.parent if is_onnx else None)
    return place.name if is_onnx else name, target


def find_entry(name: str) -> str:
    """Return where a method is defined, ``module:attribute``, without importing it.

    Raises
    ------
    UnknownNameError
        If the name has no colon and no method is registered under it.

    Examples
    --------
    >>> find_entry("constant"), find_entry("mine.py:predict")
    ('dfdbench.methods.baselines:Constant', 'mine.py:predict')
    """
    if ":" in name:
        return name
    if name.endswith(ONNX):
        return f"{name}:OnnxMethod"
    registered = registered_methods()
    if name not in registered:
        near = near_entry(name)
        own = "a method of your own: file.py:function, module:function or model.onnx"
        raise unknown_name("method", name, registered, f"did you mean {near}?" if near else own)
    return registered[name]


def _constructed(entry: str, target: type, arguments: Mapping[str, Any]) -> Any:
    try:
        return target(**arguments)
    except MethodError:
        raise
    except (Exception, SystemExit) as error:
        raise error_of("the method cannot be constructed", entry, error) from error


def entry_of(target: Callable[..., Any]) -> str:
    """Return the ``module:attribute`` from which a function or class can be imported.

    Raises
    ------
    MethodError
        If it cannot be imported by name, or could change unnoticed: a lambda, a nested function,
        an object, or anything typed into an interpreter.

    Examples
    --------
    >>> entry_of(load)
    'dfdbench.methods.registry:load'
    """
    place, name = getattr(target, "__module__", ""), getattr(target, "__qualname__", "")
    module = sys.modules.get(place)
    # Code piped into Python gives its file as "<stdin>".
    in_file = Path(getattr(module, "__file__", None) or "").is_file()
    if not in_file or getattr(module, name, None) is not target:
        what = f"the method has no name under which it could be found again: {repr(target)[:80]}"
        fix = "put it at the top of a file and pass 'file.py:name', of an object its class"
        raise MethodError(what, where=name or type(target).__name__, fix=fix)
    return f"{place}:{name}"
