"""What the verbs that train have in common: options, time, threads."""

from __future__ import annotations

import re
from collections.abc import Callable
from enum import StrEnum
from typing import Annotated

import typer

from dfdbench.errors import InputError

RESUMED = "--resume goes on from the last checkpoint, at most a minute back"
#: More than any machine has; a library that is asked for millions of them is killed.
MOST_THREADS = 1024
_SECONDS = {"h": 3600, "m": 60, "s": 1}


class Network(StrEnum):
    """What can be trained."""

    dfd_net = "dfd-net"
    u_net = "u-net"


Configuration = Annotated[
    str,
    typer.Option(
        "--config",
        help="A TOML file, or one of: published, published-realworld, demo, demo-fine, "
        "demo-u-net, robust, quick.",
    ),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a setting of the file; docs/training.md lists them.",
    ),
]
Weights = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Start from these weights, a file or a shipped name, instead of random ones.",
    ),
]
MaxTime = Annotated[
    str | None,
    typer.Option(metavar="30m", help="Stop a training after this time, as 90s, 30m, 1h30m."),
]
Threads = Annotated[
    int | None,
    typer.Option(min=1, max=MOST_THREADS, help="Processor threads; default: one per core."),
]
Device = Annotated[str, typer.Option(help="auto, cpu, cuda or mps.")]


def seconds_of(text: str | None) -> float | None:
    """Return a duration such as ``1h30m`` in seconds.

    Raises
    ------
    InputError
        Where it is none.

    Examples
    --------
    >>> seconds_of("1h30m")
    5400.0
    """
    if text is None:
        return None
    parts = re.fullmatch(r"(?:(\d+(?:\.\d+)?)h)?(?:(\d+(?:\.\d+)?)m)?(?:(\d+(?:\.\d+)?)s)?", text)
    if not parts or not any(float(part or 0) for part in parts.groups()):
        raise InputError(
            "not a duration", where="--max-time", expected="as 90s, 30m, 1h30m", got=text
        )
    units = zip(parts.groups(), _SECONDS.values(), strict=True)
    return sum(float(part or 0) * unit for part, unit in units)


def use_threads(threads: int | None) -> None:
    """Let PyTorch use this many processor threads; None leaves its choice."""
    if threads is not None:
        import torch

        torch.set_num_threads(threads)


def stepping(bar: Callable[[int, int | None], None]) -> Callable[[int, int | None, float], None]:
    """Return what a training calls with (done, total, loss): it moves a bar."""

    def step(done: int, steps: int | None, loss: float) -> None:
        bar(done, steps)

    return step
