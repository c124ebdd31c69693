"""JSON and TOML as text."""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic_core import to_json

from dfdbench.errors import InputError, Problem

#: Separates the trainings in `trained_on`, latest first, if weights started from other weights.
TRAININGS = "; "

_HALF = re.compile(r"\\u[dD][89a-fA-F]")


def parse_json(text: str | bytes) -> Any:
    """Parse the JSON of a file.

    Raises
    ------
    ValueError
        If it is not JSON, is nested too deep, has a number of thousands of digits, contains half a
        character, which cannot be written to a file, or repeats a key in one object: another reader
        would take the other value.

    Examples
    --------
    >>> parse_json('{"view": [1, 5]}')
    {'view': [1, 5]}
    """
    try:
        content = json.loads(text, object_pairs_hook=_without_twins)
    except RecursionError as error:
        raise ValueError("nested too deep") from error
    if _HALF.search(text if isinstance(text, str) else text.decode("utf-8", "replace")):
        try:
            json.dumps(content, ensure_ascii=False).encode()
        except UnicodeEncodeError as error:
            half = ascii(error.object[error.start])
            raise ValueError(f"a lone surrogate, {half}: half a character is no text") from error
    return content


def as_json(kind: str, **content: Any) -> str:
    """Format an answer as a JSON file with its kind and content; NaN becomes null.

    Examples
    --------
    >>> print(as_json("bound", spread=float("nan")), end="")
    {
     "format": "dfdbench bound",
     "schema_version": 1,
     "spread": null
    }
    """
    whole = {"format": f"dfdbench {kind}", "schema_version": 1, **content}
    return to_json(whole, indent=1, inf_nan_mode="null").decode() + "\n"


def _without_twins(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twin = next(name for name in found if names.count(name) > 1)
        raise ValueError(f"the key {twin[:60]!r} twice")
    return found


def differences(
    before: Mapping[str, Any], now: Mapping[str, Any], name: str = ""
) -> Iterator[tuple[str, Any, Any]]:
    """Yield the differences of two nested records: dotted name, value before, value now.

    Parameters
    ----------
    before, now : mapping of str
        As parsed from JSON. A value missing from one of them is None there.
    name : str, optional
        A prefix of each name.

    Examples
    --------
    >>> list(differences({"seed": 1, "net": {"width": 8}}, {"seed": 1, "net": {"width": 4}}))
    [('net.width', 8, 4)]
    """
    for key in dict.fromkeys([*before, *now]):
        one, other = before.get(key), now.get(key)
        if isinstance(one, dict) and isinstance(other, dict):
            yield from differences(one, other, f"{name}{key}.")
        elif one != other:
            yield f"{name}{key}", one, other


def require_same(
    before: Mapping[str, Any], now: Mapping[str, Any], what: str, where: str, fix: str = ""
) -> None:
    """Raise an InputError that names every difference of two nested records."""
    InputError.raise_if(
        Problem(f"{what}, with {name} {one} instead of {other}", where=where, fix=fix)
        for name, one, other in differences(before, now)
    )


def toml_text(content: Mapping[str, Any]) -> str:
    """Format texts, numbers, switches and lists of them as TOML, one line per name.

    Examples
    --------
    >>> print(toml_text({"filters": [4, 256], "schedule": "cosine", "decay_prelu": True}), end="")
    filters = [4, 256]
    schedule = "cosine"
    decay_prelu = true
    """
    # For these types, what JSON writes is valid TOML with the same meaning.
    return "".join(f"{name} = {json.dumps(value)}\n" for name, value in content.items())


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML.

    Raises
    ------
    ValueError
        If it is not TOML, is nested deeper than anything meaningful, or has a number of thousands
        of digits.

    Examples
    --------
    >>> parse_toml("axes = { view = [1, 5] }")
    {'axes': {'view': [1, 5]}}
    """
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deep") from error
