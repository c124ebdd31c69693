"""How often each depth level occurs, as a table."""

from __future__ import annotations

import numpy as np

from dfdbench.audit.level_ranges import as_ranges
from dfdbench.audit.sides import Side
from dfdbench.blur.recipe import LEVELS
from dfdbench.tables.table import Table
from dfdbench.tables.wording import counted, percent

_BAND = 16


def depth_table(side: Side) -> Table:
    """Return how often levels occur: 16 of them a row, as records each by itself.

    Parameters
    ----------
    side : Side
        The scenes of a built set that are counted.
    """
    histogram = side.histogram
    counts, known = histogram.counts, histogram.known
    rows = []
    for first in range(0, LEVELS, _BAND):
        inside = np.zeros(LEVELS, bool)
        inside[first : first + _BAND] = True
        pixels = int(counts[inside].sum())
        absent = inside & (counts == 0)
        gaps = "all" if not pixels else as_ranges(absent) or "–"
        rows.append((f"{first}-{first + _BAND - 1}", f"{pixels:,}", percent(pixels / known), gaps))
    everything = known + histogram.unknown
    notes = [
        f"{known:,} pixels of known depth; unknown, and left out, are "
        f"{percent(histogram.unknown / everything)} of all",
        "pixels: each depth map once for each of its pairs in the manifest; the level "
        f"grows with {side.store.manifest.depth.grows_with}",
        "--format csv and --format json have each level by itself",
    ]
    if side.absent:
        notes.append(f"not in the store, so not counted: {', '.join(side.absent)}")
    scenes = counted(len(side.scenes), "scene")
    return Table(
        f"depths of {side.label}, {side.name} ({counted(histogram.pairs, 'pair')} of {scenes})",
        ("levels", "pixels", "share", "do not occur"),
        tuple(rows),
        "lrrl",
        tuple(notes),
        records=tuple(
            {"level": level, "pixels": int(count), "share": int(count) / known}
            for level, count in enumerate(counts)
        ),
    )
