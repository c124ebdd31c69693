"""Which protocol a data set's tables show, and its board is headed by, where none is named."""

from __future__ import annotations

from dfdbench.datasets.manifest import Manifest
from dfdbench.metrics.protocol import find_protocol, protocols_of, require_scored
from dfdbench.results.record import Result

# The thesis's printed tables are held against these sets, under its own protocol. On any other it
# flatters everyone: it counts pixels whose depth nobody knows as depth 0.
_HEADED_BY_THESIS = ("demo", "middlebury", "realworld", "realworld-synthetic")


def first_protocol(short: str) -> str:
    """Return the protocol that a data set is shown and ranked by first.

    Parameters
    ----------
    short : str
        The data set's short name, with its track.

    Examples
    --------
    >>> first_protocol("demo"), first_protocol("demo@camera-2"), first_protocol("dfd-indoor")
    ('thesis', 'valid', 'valid')
    """
    return "thesis" if short in _HEADED_BY_THESIS else "valid"


def protocol_on(manifest: Manifest, name: str | None) -> str:
    """Return the label of a protocol that runs on a data set are scored under.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    name : str or None
        The protocol's name; None for the data set's first.

    Raises
    ------
    UnknownNameError
        If there is none, or runs on this data set are not scored under it.
    """
    label = find_protocol(name).label if name else first_protocol(manifest.short)
    there = protocols_of(manifest.depth.scale is not None)
    require_scored(label, there, f"runs on {manifest.stem}")
    return label


def shown_protocol(result: Result) -> str:
    """Return the protocol that a result is shown under first, among those that it was scored by.

    A file of the leaderboard holds one alone.
    """
    first = first_protocol(result.dataset.short)
    names = result.protocol_names
    return first if first in names else next(iter(names), first)
