"""Options that several verbs share, how their values are read, and what the shell completes."""

from __future__ import annotations

import json
import math
import os
import re
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, Option

from dfdbench.errors import InputError, Problem, refuse_both
from dfdbench.system.parallel import Cluster, Pool, Processes, Threads
from dfdbench.system.text import parse_json
from dfdbench.tables.table import Format


def data_sets(incomplete: str) -> list[str]:
    """Return the names of data sets that start with a text; after an ``@``, of their tracks.

    Examples
    --------
    >>> data_sets("middlebury-d"), data_sets("demo@camera-")
    (['middlebury-default'], ['demo@camera-1', 'demo@camera-2', 'demo@camera-3'])
    """
    from dfdbench.blur.tracks import TRACKS
    from dfdbench.datasets.catalog import own_stores, released_headings

    known = {heading.short: heading.recipe is not None for heading in released_headings()}
    name, on_track, _ = incomplete.partition("@")
    names = sorted({*known, *own_stores()})
    if on_track and known.get(name):
        names = [f"{name}@{label}" for track in TRACKS.values() for label in track.labels]
    return [found for found in names if found.startswith(incomplete)]


def methods(incomplete: str) -> list[str]:
    """Return the names of the registered methods that start with a text.

    Examples
    --------
    >>> methods("graph")
    ['graph-cuts', 'graph-cuts-rounded']
    """
    from dfdbench.methods.registry import registered_methods

    return sorted(name for name in registered_methods() if name.startswith(incomplete))


DataSet = Annotated[
    str, Option(help="A data set's name, or a store's path or URL.", autocompletion=data_sets)
]
DataSetArgument = Annotated[
    str, Argument(help="A data set's name, or a store's path or URL.", autocompletion=data_sets)
]
Fresh = Annotated[
    bool, Option("--fresh", help="Start over; an earlier run is kept as `.previous`.")
]
Method = Annotated[
    str,
    Option(help="A name, file.py:function, module:function or model.onnx.", autocompletion=methods),
]
Params = Annotated[list[str] | None, Option("--param", help="The method's NAME=VALUE; repeatable.")]
Fitted = Annotated[Path | None, Option(metavar="RUN", help="Use what this run's fit learned.")]
Split = Annotated[str, Option(help="Which pairs: a split, a fold, a scene, or all.")]


def _known_protocol(name: str | None) -> str | None:
    from dfdbench.metrics.protocol import find_protocol

    return find_protocol(name).label if name else None


Protocol = Annotated[
    str | None,
    Option(help="Scoring protocol; default: the set's usual one.", callback=_known_protocol),
]
Out = Annotated[str | None, Option(help="Folder; default: below results/.")]
TrainingOut = Annotated[str | None, Option(help="Folder; default: below training/.")]
Printed = Annotated[Format, Option(help="How the tables are printed.")]
#: For answers that are not tables.
Facts = Annotated[
    Literal["table", "json"], Option("--format", help="Lines for people, or facts as JSON.")
]
EveryTable = Annotated[
    bool,
    Option("--tables", help="Print all tables: pairs, times, spread, scenes; or see tables.md."),
]
Seed = Annotated[int, Option(min=0, max=2**32 - 1, help="Seed of all random draws.")]
Cache = Annotated[
    Path | None,
    Option(
        envvar="DFDBENCH_CACHE",
        help="Folder for downloads and built data sets; default: your system's cache folder.",
    ),
]
Workers = Annotated[
    int | None, Option(min=1, max=1024, help="How many at once; default: one per core.")
]
Scheduler = Annotated[
    str | None, Option(metavar="ADDRESS", help="A dask cluster's scheduler: tcp://node1:8786.")
]


class FigureFormat(StrEnum):
    """A figure format for papers, besides PNG; Typer takes no list of literals."""

    pdf = "pdf"
    svg = "svg"


FigureFormats = Annotated[
    list[FigureFormat] | None,
    Option("--figure-format", help="Figures as PDF or SVG too; repeatable."),
]
Submit = Annotated[
    bool, Option("--submit", help="Write the result into leaderboard/, for a pull request.")
]


def values_of(given: list[str] | None, option: str) -> dict[str, Any]:
    """Return the names and values of a repeated ``NAME=VALUE`` option, read by `value_of`.

    Raises
    ------
    InputError
        If one has no name or no value (all such are named), or a value is broken JSON.

    Examples
    --------
    >>> values_of(["noise=2", "schedule=cosine"], "--set")
    {'noise': 2, 'schedule': 'cosine'}
    """
    parts = [text.partition("=") for text in given or []]
    InputError.raise_if(
        Problem("not a NAME=VALUE", where=option, got=f"{name}{equals}{value}")
        for name, equals, value in parts
        if not (name and equals)
    )
    return {name: value_of(value, f"{option} {name}") for name, _, value in parts}


def value_of(text: str, where: str) -> Any:
    """Return a text parsed as JSON if it is JSON, else unchanged.

    Raises
    ------
    InputError
        If it starts like a JSON object or list but is not one.
    """
    try:
        return parse_json(text)
    except ValueError as error:
        if not text.lstrip().startswith(("{", "[")):
            return text
        why = str(error)
        if isinstance(error, json.JSONDecodeError):
            why = f"{error.msg} at character {error.pos + 1}"
        fix = 'write it as {"name": 0.5}, or put a text into double quotes'
        raise InputError(f"broken JSON: {why} of {text[:200]}", where=where, fix=fix) from None


def several(values: Any, where: str) -> list[Any]:
    """Return the values to try: a text is split at commas, each part read by `value_of`.

    Examples
    --------
    >>> several("7,31,91", "--range window"), several(0.5, "--range smoothing")
    ([7, 31, 91], [0.5])
    """
    if isinstance(values, str):
        return [value_of(text, where) for text in dict.fromkeys(map(str.strip, values.split(",")))]
    return values if isinstance(values, list) else [values]


def pool_of(workers: int | None, scheduler: str | None = None) -> Pool:
    """Return where our own work is done: in threads unless on a cluster.

    Raises
    ------
    InputError
        If both are given: a cluster has its own number of workers.
    """
    return _cluster(workers, scheduler) or Threads(workers or os.cpu_count() or 1)


def pool_of_processes(workers: int | None, scheduler: str | None) -> Pool | None:
    """Return where methods are called; None for this process, one pair at a time.

    Raises
    ------
    InputError
        As for `pool_of`.
    """
    here = Processes(workers) if workers and workers > 1 else None
    return _cluster(workers, scheduler) or here


def _cluster(workers: int | None, scheduler: str | None) -> Cluster | None:
    refuse_both({"--scheduler": scheduler}, {"--workers": workers})
    # An empty address, from an unset variable say, is a mistake: do not run on this machine.
    return None if scheduler is None else Cluster(scheduler)


#: A longer pixel is a mistake in the unit.
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
        The unit of a number without one; by default such a number is refused.
    at_most : str, optional
        The longest plausible length, with its unit.

    Raises
    ------
    InputError
        If the text is not a positive length, its unit is unknown, or it is too long.

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
        what = f"not a positive length with its unit, as 9.6mm, 0.5m or 4.8um: {text}"
        raise InputError(what, where=where)
    length = number * _METRES[found]
    if at_most and length > parse_length(at_most, where):
        raise InputError("too long", where=where, expected=f"{at_most} at most", got=text)
    return length
