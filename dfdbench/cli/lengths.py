"""Read lengths as people write them: 9.6mm, 0.5m, 4.8um."""

from __future__ import annotations

import math
import re

from dfdbench.errors import InputError

#: A longer one is a slip of the unit.
LARGEST_PIXEL = "1mm"

_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9}
_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*")


def parse_length(text: str, where: str, unit: str = "", at_most: str = "") -> float:
    """Return a length in metres.

    Parameters
    ----------
    text : str
        A number and a unit: m, cm, mm, um or nm.
    where : str
        What the length is, for the message: an option, say.
    unit : str, optional
        The unit of a number that bears none; by default such a number is refused.
    at_most : str, optional
        The longest that can be meant, as a length with its unit.

    Raises
    ------
    InputError
        Where the text is no positive length, its unit is not known, or it is too long.

    Examples
    --------
    >>> parse_length("9.6mm", "--focal-length")
    0.0096
    >>> parse_length("1.5", "--range", unit="m")
    1.5
    """
    match = _LENGTH.fullmatch(text)
    number, found = (float(match[1]), match[2] or unit) if match else (math.nan, "")
    if not number > 0 or not math.isfinite(number) or found not in _METRES:
        raise InputError(
            "not a length",
            where=where,
            expected="a positive number and a unit: 9.6mm, 0.5m, 4.8um",
            got=text,
        )
    length = number * _METRES[found]
    if at_most and length > parse_length(at_most, where):
        raise InputError("too long", where=where, expected=f"{at_most} at most", got=text)
    return length
