"""The command line, called as a user calls it."""

from collections.abc import Callable
from typing import NamedTuple


class Outcome(NamedTuple):
    status: int
    out: str
    err: str


Command = Callable[..., Outcome]

#: Options of a training that ends after a few small steps.
QUICK = [
    "--set",
    "narrow=64",
    "--set",
    "crop=16",
    "--set",
    "crops_per_step=1",
    "--set",
    "steps=4",
    "--set",
    "evaluate_every=2",
    "--set",
    "evaluate_pairs=1",
    "--device",
    "cpu",
    "--threads",
    "1",
]
