"""What a method's class or function takes: parameters by name, checked before it is called."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from dfdbench.errors import MethodError, Problem


def is_class(target: object) -> bool:
    """Return whether something is a class, by what it is and not by what it says that it is.

    Examples
    --------
    >>> is_class(str), is_class("text")
    (True, False)
    """
    return issubclass(type(target), type)


def parameters_of(target: Callable[..., Any]) -> set[str]:
    """Return the names of what a callable takes; none where it does not tell.

    Examples
    --------
    >>> sorted(parameters_of(lambda infocus, defocus: None))
    ['defocus', 'infocus']
    """
    try:
        return set(inspect.signature(target).parameters)
    except Exception:  # a signature of its own may raise anything
        return set()


def check_parameters(entry: str, target: Callable[..., Any], arguments: Mapping[str, Any]) -> None:
    """Do nothing where a callable takes these arguments, and a class needs no others.

    Raises
    ------
    MethodError
        Naming each parameter that is unknown, or is needed.
    """
    try:
        signature = inspect.signature(target)
    except Exception:
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
    if is_class(target) and missing:
        raise MethodError.of(
            [
                Problem(
                    "parameter is needed", where=entry, expected=name, fix=f"--param {name}=VALUE"
                )
                for name in missing
            ]
        )
