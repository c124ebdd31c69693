"""What the rig's verbs are told: scenes, numbers, and a data set that was captured."""

from __future__ import annotations

import re
from collections.abc import Sequence

from dfdbench.datasets.manifest import Manifest, Recording
from dfdbench.errors import InputError, UnknownNameError, unknown_name


def capture_of(manifest: Manifest) -> Recording:
    """Return how a data set was captured.

    Raises
    ------
    InputError
        Where it was not captured by the rig.
    """
    if manifest.capture is None:
        raise InputError(
            "not captured by the rig", where="--dataset", expected="realworld", got=manifest.short
        )
    return manifest.capture


def chosen_scenes(text: str, manifest: Manifest) -> tuple[str, ...]:
    """Return the scenes that a list names, as ``k00-k07,k33``, in the manifest's order.

    Raises
    ------
    UnknownNameError
        Where it names one that the manifest lacks.
    InputError
        Where a span goes backwards.
    """
    known = manifest.scene_names
    chosen: set[str] = set()
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        for name in (first, last or first):
            if name not in known:
                near = unknown_name("scene", name, known).problems[0].fix
                raise UnknownNameError(
                    "unknown scene",
                    where="",
                    expected=f"of {known[0]} to {known[-1]}",
                    got=name,
                    fix=near,
                )
        begin, end = known.index(first), known.index(last or first)
        if end < begin:
            raise InputError("no scene in that span", got=part.strip(), fix=f"{last}-{first}")
        chosen.update(known[begin : end + 1])
    return tuple(name for name in known if name in chosen)


def chosen_numbers(text: str, option: str, known: Sequence[int]) -> tuple[int, ...]:
    """Return the numbers that a list names, as ``127-131,141``, ascending.

    Raises
    ------
    InputError
        Where it is no such list, a span goes backwards, or names what is not known.
    """
    expected = ", ".join(map(str, known))
    chosen: set[int] = set()
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        if not ends:
            raise InputError(
                "not a list of numbers",
                where=option,
                expected=f"as {known[0]} or {known[0]}-{known[-1]}, of {expected}",
                got=text,
            )
        first, last = int(ends[1]), int(ends[2] or ends[1])
        if last < first:
            raise InputError(
                "no number in that span", where=option, got=part.strip(), fix=f"{last}-{first}"
            )
        # A span may pass over what is not known, as 10-70 over 15; its ends may not.
        if not {first, last} <= set(known):
            raise InputError(
                "unknown value", where=option, expected=f"of {expected}", got=part.strip()
            )
        chosen.update(number for number in known if first <= number <= last)
    return tuple(sorted(chosen))
