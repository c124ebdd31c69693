"""Which protocol a table shows where none is named."""

from __future__ import annotations

from dfdbench.blur.tracks import CLEAN

# The thesis's own captures: its printed tables are under its own protocol.
_THESIS = "realworld"


def first_protocol(short: str, recipe: str, degradation: str) -> str:
    """Return the protocol that a data set's tables show unless another is named.

    ``thesis``, whose printed numbers are the reference, but ``valid`` of captured sets: what was
    measured has pixels without depth, which ``thesis`` counts as depth 0.

    Parameters
    ----------
    short : str
        The data set's short name.
    recipe : str
        The name of its blur recipe; empty where the defocus images are captured.
    degradation : str
        ``clean``, or the track that it is on.

    Examples
    --------
    >>> first_protocol("demo", "published", "clean"), first_protocol("dfd-indoor", "", "clean")
    ('thesis', 'valid')
    """
    captured = not recipe and degradation == CLEAN
    return "valid" if captured and short != _THESIS else "thesis"
