"""Numbers that a checkpoint says, looked at before they are trusted.

Each check raises a `ValueError` that says what it found, for the folder to tell where.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def whole_number(state: Mapping[str, Any], name: str, most: int | None = None) -> int:
    """Return a number of a state that is whole, 0 or more.

    Raises
    ------
    ValueError
        Where it is not, or exceeds `most`.

    Examples
    --------
    >>> whole_number({"step": 3}, "step", 5)
    3
    >>> whole_number({"step": True}, "step")
    Traceback (most recent call last):
    ValueError: step is a bool; expected a whole number, 0 or more
    """
    value = state[name]
    if type(value) is not int or value < 0:
        said = value if type(value) is int and abs(value) < 10**18 else f"a {type(value).__name__}"
        raise ValueError(f"{name} is {said}; expected a whole number, 0 or more")
    if most is not None and value > most:
        raise ValueError(f"{name} is beyond the {most:,} that there are")
    return value


def finite_number(state: Mapping[str, Any], name: str, most: float) -> float:
    """Return a number of a state that lies between 0 and `most`.

    Raises
    ------
    ValueError
        Where it does not.

    Examples
    --------
    >>> finite_number({"rate": float("nan")}, "rate", 1)
    Traceback (most recent call last):
    ValueError: rate is no number from 0 to 1
    """
    value = state[name]
    if type(value) not in (int, float) or not 0 <= value <= most:
        raise ValueError(f"{name} is no number from 0 to {most:g}")
    return float(value)


def finite_numbers(state: Mapping[str, Any], name: str, most: int) -> list[float]:
    """Return a list of a state: finite numbers, at most so many.

    Raises
    ------
    ValueError
        Where it is none.
    """
    values = state[name]
    if not isinstance(values, list) or len(values) > most:
        raise ValueError(f"{name} is no list of {most:,} numbers at most")
    if not all(type(value) is float and math.isfinite(value) for value in values):
        raise ValueError(f"{name} holds what is no number")
    return values
