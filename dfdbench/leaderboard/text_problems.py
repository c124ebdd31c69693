"""Whether what a submitted result says in words can be shown: seen, on one line, and not too long.

What cannot be seen steers a terminal, or makes one method's name look like another's.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from dfdbench.errors import Problem
from dfdbench.results.record import Result

_LONGEST_TEXT = 1000
#: Of all parameters as JSON: a blur law has a width for each of 256 levels.
_LONGEST_PARAMETERS = 20_000
_LARGEST_INTEGER = 2**63


def text_problems(result: Result, where: str) -> Iterator[Problem]:
    """Return which texts of a result cannot be shown; what a run warned of is not shown at all."""
    parts = {
        "dataset": dict(result.dataset),
        "method": dict(result.method),
        "environment": dict(result.environment),
        "other_environments": {
            str(number): dict(each) for number, each in enumerate(result.other_environments, 1)
        },
        "protocols": result.protocols,
    }
    for name, part in parts.items():
        for field, value in _leaves(part, name):
            if isinstance(value, str) and not value.isprintable():
                yield Problem(
                    "text with characters that cannot be seen",
                    where=f"{where}: {field}",
                    expected="letters, digits, punctuation and blanks, on one line",
                    got=ascii(value)[:_LONGEST_TEXT],
                )
            too_long = isinstance(value, str) and len(value) > _LONGEST_TEXT
            if too_long or (isinstance(value, int) and abs(value) >= _LARGEST_INTEGER):
                yield Problem(
                    "a value that is too long to be shown",
                    where=f"{where}: {field}",
                    expected=f"at most {_LONGEST_TEXT} characters, or an integer of 64 bits",
                    got=ascii(value)[:80],
                )
    length = len(json.dumps(result.method.parameters))
    if length > _LONGEST_PARAMETERS:
        yield Problem(
            "parameters that are too long to be shown",
            where=f"{where}: method.parameters",
            expected=f"at most {_LONGEST_PARAMETERS} characters of JSON",
            got=str(length),
        )


def _leaves(part: Any, name: str) -> Iterator[tuple[str, Any]]:
    # Not by recursion: what is nested deep is somebody else's too. Keys are texts like values.
    left = [(name, part)]
    while left:
        place, value = left.pop()
        if isinstance(value, dict):
            left += [(place, key) for key in value]
            left += [(f"{place}.{key}"[:100], held) for key, held in value.items()]
        elif isinstance(value, list):
            left += [(place, held) for held in value]
        else:
            yield place, value
