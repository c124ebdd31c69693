"""Read TOML that somebody wrote, however strange it is."""

from __future__ import annotations

import tomllib
from typing import Any


def parse_toml(text: str) -> dict[str, Any]:
    """Return what TOML says.

    Raises
    ------
    ValueError
        Where it is no TOML, is nested deeper than anything that means something, or has a number
        of thousands of digits.

    Examples
    --------
    >>> parse_toml("axes = { view = [1, 5] }")
    {'axes': {'view': [1, 5]}}
    """
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deep") from error
