"""What the shell offers for a half-typed data set or method."""

from __future__ import annotations


def data_sets(incomplete: str) -> list[str]:
    """Return the names of data sets that begin so; behind an ``@`` those of their tracks.

    Examples
    --------
    >>> data_sets("middlebury-d"), data_sets("demo@camera-")
    (['middlebury-default'], ['demo@camera-1', 'demo@camera-2', 'demo@camera-3'])
    """
    from dfdbench.blur.tracks import TRACKS
    from dfdbench.datasets.catalog import released_manifests
    from dfdbench.datasets.store_place import own_stores

    known = {manifest.short: manifest.recipe is not None for manifest in released_manifests()}
    name, on_track, _ = incomplete.partition("@")
    names = sorted({*known, *own_stores()})
    if on_track and known.get(name):
        names = [
            f"{name}@{track.name}-{severity}"
            for track in TRACKS.values()
            for severity in range(1, len(track.severities) + 1)
        ]
    return [found for found in names if found.startswith(incomplete)]


def methods(incomplete: str) -> list[str]:
    """Return the names of the registered methods that begin so.

    Examples
    --------
    >>> methods("graph")
    ['graph-cuts', 'graph-cuts-rounded']
    """
    from dfdbench.methods.registry import registered_methods

    return sorted(name for name in registered_methods() if name.startswith(incomplete))
