"""Frozen records with checked fields, and the problems of an invalid one in words."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields
from functools import cache
from typing import Annotated, Any, TypeVar, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from dfdbench.errors import InputError, Problem

Made = TypeVar("Made")
#: A length, a distance or a ratio: finite and above zero.
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
#: A factor of the light; a channel's curve has some at even steps of r^2, from the middle outwards.
Share = Annotated[float, Field(ge=0.01, le=100)]
STEPS = Field(min_length=2, max_length=100)
#: The pattern of a text on one line, without control characters.
LINE = r"^[^\x00-\x1f\x7f-\x9f]*[^\s\x00-\x1f\x7f-\x9f][^\x00-\x1f\x7f-\x9f]*$"
_PREAMBLE = re.compile(r"^(\w+ should (be )?|Value error, )")
# Pydantic's kinds of errors, or the pattern, in our words.
_WORDS = {
    LINE: "one line of text, not blank",
    "too_short": "{min_length} or more of them",
    "invalid-json-value": "text, a number, true, false, a list or a table",
    "string_type": "text",
    "list_type": "a list",
    "dict_type": "a table",
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number"),
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    "greater_than": "more than {gt}",
    "greater_than_equal": "{ge} or more",
    "less_than": "less than {lt}",
    "less_than_equal": "{le} or less",
}
_LONGEST = 80


class Record(BaseModel):
    """A frozen record that refuses unknown fields."""

    # Build the validator on first use: most records are never used.
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class StrictRecord(Record):
    """A record that refuses values of another type, since TOML distinguishes text from numbers."""

    model_config = ConfigDict(strict=True)


def problems_of(error: ValidationError, what: str, *, file: object, fix: str = "") -> list[Problem]:
    """Return the problems of a record: each field that pydantic refused.

    Parameters
    ----------
    error : ValidationError
        From the record.
    what : str
        The problem in a few words, if a value does not fit.
    file : str or Path
        Where the record is from.
    fix : str, optional
        What the user can do about it.

    Examples
    --------
    >>> class Shelf(Record):
    ...     books: list[int]
    >>> try:
    ...     Shelf(books=[3, "x"])
    ... except ValidationError as error:
    ...     print(*problems_of(error, "wrong value", file="shelf.json"))
    wrong value (shelf.json: books[1]): expected a whole number, got 'x'
    """
    problems = []
    for detail in error.errors():
        place = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in detail["loc"])
        where = f"{file}: {place.removeprefix('.')}" if place else str(file)
        got = repr(detail["input"])[:_LONGEST]
        match detail["type"]:
            case "missing":
                problem = Problem("field is missing", where=where, fix=fix)
            case "extra_forbidden":
                problem = Problem("unknown field", where=where, got=got, fix=fix)
            case "json_invalid":
                problem = Problem(f"broken JSON: {detail['ctx']['error']}", where=where, fix=fix)
            case kind:
                # A record that contradicts itself is too long to show as a whole.
                whole = kind == "value_error" and isinstance(detail["input"], dict)
                expected = _PREAMBLE.sub("", detail["msg"])
                context = detail.get("ctx", {})
                if words := _WORDS.get(context.get("pattern", kind)):
                    expected = words.format(**context)
                got = "" if whole else got
                problem = Problem(what, where=where, expected=expected, got=got, fix=fix)
        problems.append(problem)
    return problems


def check_fields(record: Any, what: str) -> None:
    """Check a dataclass's values strictly against the annotations of its fields.

    Raises
    ------
    InputError
        With every field that is wrong; `what` names the record.
    """
    values = {field.name: getattr(record, field.name) for field in fields(record)}
    InputError.raise_if(list(_wrong_values(type(record), values, what)))


def made_of(kind: type[Made], given: Mapping[str, Any], what: str) -> Made:
    """Return a dataclass made from its fields by name.

    Raises
    ------
    InputError
        With every field that is unknown, missing or wrong; `what` names the record.
    """
    known = {field.name: field.default for field in fields(kind)}  # type: ignore[arg-type]
    unknown = [name for name in given if name not in known]
    lacking = [name for name in known if known[name] is MISSING and name not in given]
    problems = [
        *(Problem(f"unknown field of a {what}", where=str(name)) for name in unknown),
        *(Problem(f"a field of the {what} is lacking", where=name) for name in lacking),
        *_wrong_values(kind, {name: given[name] for name in known if name in given}, what),
    ]
    InputError.raise_if(problems)
    return kind(**given)


def _wrong_values(kind: type, values: Mapping[str, Any], what: str) -> Iterator[Problem]:
    for name, value in values.items():
        try:
            _adapters(kind)[name].validate_python(value, strict=True)
        except ValidationError as error:
            yield from problems_of(error, f"wrong {what}", file=name)


@cache
def _adapters(kind: type) -> dict[str, TypeAdapter[Any]]:
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: TypeAdapter(hints[field.name]) for field in fields(kind)}
