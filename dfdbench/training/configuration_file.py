"""Read the configuration of a training: a shipped one, or a file, with changes."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dfdbench.errors import InputError, Problem, reason_of
from dfdbench.system.files import read_whole
from dfdbench.system.record import problems_of
from dfdbench.system.toml_text import parse_toml
from dfdbench.training.configuration import TrainingConfiguration


def shipped_configurations() -> dict[str, str]:
    """Return the texts of the configurations that come with the package, by name."""
    folder = files("dfdbench.training.configurations")
    return {
        item.name.removesuffix(".toml"): item.read_text(encoding="utf-8")
        for item in sorted(folder.iterdir(), key=lambda item: item.name)
        if item.name.endswith(".toml")
    }


def read_configuration(
    name: str, changes: Mapping[str, Any] | None = None
) -> TrainingConfiguration:
    """Return a configuration: a shipped one by name, or that of a TOML file.

    Parameters
    ----------
    name : str
        A name, or a file's path.
    changes : mapping, optional
        Values to put in place of the file's.

    Raises
    ------
    InputError
        Where there is no such file, or it holds something else; every problem is named.

    Examples
    --------
    >>> read_configuration("published", {"noise": 2}).noise
    2.0
    """
    shipped = shipped_configurations()
    if name in shipped:
        text = shipped[name]
    elif Path(name).is_file():
        text = _text_of(name)
    else:
        raise InputError(
            "no such configuration",
            where="--config",
            expected=f"a file, or one of: {', '.join(shipped)}",
            got=name,
        )
    try:
        choices = {**parse_toml(text), **(changes or {})}
    except ValueError as error:
        raise InputError("not a TOML file", where=name, got=str(error)) from error
    return _checked(choices, name)


def _text_of(name: str) -> str:
    try:
        return read_whole(Path(name)).decode("utf-8", errors="replace")
    except OSError as error:
        got = reason_of(error)
        raise InputError("cannot read the configuration", where=name, got=got) from error


def _checked(choices: Mapping[str, Any], name: str) -> TrainingConfiguration:
    known = TrainingConfiguration.model_fields
    problems = [
        Problem(
            "unknown choice",
            where=f"{name}: {choice}",
            expected=f"one of: {', '.join(known)}",
            got=choice,
        )
        for choice in choices
        if choice not in known
    ]
    try:
        configuration = TrainingConfiguration.model_validate(
            {choice: value for choice, value in choices.items() if choice in known}
        )
    except ValidationError as error:
        what = "the configuration cannot be used"
        raise InputError.of([*problems, *problems_of(error, what, file=name)]) from error
    if problems:
        raise InputError.of(problems)
    return configuration
