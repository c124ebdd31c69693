"""Depth levels told as ranges."""

from __future__ import annotations

from collections.abc import Sequence

from dfdbench.audit.depth_histogram import Mask


def runs(keys: Sequence[object]) -> list[tuple[int, int]]:
    """Return first and last index of each run of equal keys, None left out.

    Examples
    --------
    >>> runs(["a", "a", None, "b"])
    [(0, 1), (3, 3)]
    """
    found: list[tuple[int, int]] = []
    for level, key in enumerate(keys):
        if key is None:
            continue
        if found and found[-1][1] == level - 1 and keys[level - 1] == key:
            found[-1] = (found[-1][0], level)
        else:
            found.append((level, level))
    return found


def range_text(first: int, last: int) -> str:
    """Return a range of levels as text, one level where both ends are the same.

    Examples
    --------
    >>> range_text(36, 38), range_text(9, 9)
    ('36-38', '9')
    """
    return str(first) if first == last else f"{first}-{last}"


def as_ranges(levels: Mask) -> str:
    """Return marked levels as ranges.

    Examples
    --------
    >>> import numpy as np
    >>> marked = np.zeros(256, bool)
    >>> marked[[9, 36, 37, 38]] = True
    >>> as_ranges(marked)
    '9, 36-38'
    """
    return ", ".join(range_text(*run) for run in runs([True if mark else None for mark in levels]))
