"""A result's file: written whole, and read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dfdbench.errors import ResultError, reason_of
from dfdbench.results.record import Result, average
from dfdbench.system.files import read_text, write_whole
from dfdbench.system.strict import problems_of
from dfdbench.system.text import parse_json

RESULT_SCHEMA_VERSION = 1
#: What a result is called in the folder of its run.
RESULT = "result.json"


def save_result(result: Result, path: Path) -> None:
    """Write a result as JSON, whole or not at all."""
    write_whole(path, result.model_dump_json(indent=1) + "\n")


def load_result(path: Path | str) -> Result:
    """Read a run's result, check it, and compute its averages anew.

    Parameters
    ----------
    path : Path or str
        The result file, or the folder of the run.

    Raises
    ------
    ResultError
        Where it cannot be read, is of another schema version, or contradicts itself.
    """
    path = Path(path)
    path = path / RESULT if path.is_dir() else path
    content = read_json(path)
    found = content.get("schema_version") if isinstance(content, dict) else None
    # True equals 1 too.
    if type(found) is not int or found != RESULT_SCHEMA_VERSION:
        what = f"result of version {found}, not {RESULT_SCHEMA_VERSION}"
        fix = "run the method again with this version of dfdbench"
        raise ResultError(what, where=str(path), fix=fix)
    try:
        result = Result.model_validate(content, strict=True)
    except ValidationError as error:
        problems = problems_of(error, "wrong value in the result", file=path)
        raise ResultError.of(problems) from error
    means = average(result.pairs, list(result.protocol_names)) if result.complete else None
    return result.model_copy(update={"averages": means})


def read_json(path: Path) -> Any:
    """Return what a JSON file that a run wrote says.

    Raises
    ------
    ResultError
        Where it cannot be read.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        what = f"cannot read the result: {reason_of(error)}"
        fix = "name what `dfdbench run` wrote: results/DATASET-SPLIT/METHOD"
        raise ResultError(what, where=str(path), fix=fix) from error
    try:
        return parse_json(text)
    except ValueError as error:
        what = f"the result is damaged: {error if text.strip() else 'an empty file'}"
        fix = "the same `dfdbench run` writes it anew, from the pairs that it kept"
        raise ResultError(what, where=str(path), fix=fix) from error
