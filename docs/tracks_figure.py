"""Draw what each track makes of a pair: python docs/tracks_figure.py STORE OUT [PAIR].

STORE is a built data set without a track, OUT the picture. A row a track: a part of the clean
defocus image, of that at severities 1 to 3, and what these differ from the clean one, four times
as large.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.blur.formation import form_pair
from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.blur.tracks import TRACKS, find_degradation
from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import Dataset

SEVERITIES = (1, 2, 3)
SHOWN = (96, 128)
LARGER = 4


def part_with_edges(images: Capture) -> tuple[slice, slice]:
    """Return the part of a pair with the most depth edges, where tracks differ most."""
    depth = images.levels.astype(np.int64)
    edges = np.zeros(depth.shape)
    edges[:, 1:] = np.minimum(np.abs(np.diff(depth, axis=1)), 60) * images.valid[:, 1:]
    corners = [
        (top, left)
        for top in range(0, depth.shape[0] - SHOWN[0] + 1, 8)
        for left in range(0, depth.shape[1] - SHOWN[1] + 1, 8)
    ]
    top, left = max(
        corners or [(0, 0)],
        key=lambda at: edges[at[0] : at[0] + SHOWN[0], at[1] : at[1] + SHOWN[1]].sum(),
    )
    return slice(top, top + SHOWN[0]), slice(left, left + SHOWN[1])


def defocus_images(store: Dataset, images: Capture, track: str) -> list[NDArray[np.uint8]]:
    """Return a pair's defocus image, clean and at each severity of a track."""
    if store.recipe is None:
        raise SystemExit(f"{store.path}: needs a data set whose blur recipe is known")
    depth = images.levels
    if store.manifest.depth.grows_with == "distance":
        depth = LAST_LEVEL - depth
    return [
        form_pair(
            images.infocus,
            depth,
            store.recipe,
            find_degradation(f"{track}-{severity}"),
            images.pair.id,
        )[1]
        for severity in (0, *SEVERITIES)
    ]


def main(store_path: str, out: str, pair_id: str = "") -> None:
    """Draw the picture."""
    store = Dataset(Path(store_path))
    pairs = {pair.id: pair for pair in store.pairs("all")}
    images = store.read(pairs[pair_id] if pair_id else next(iter(pairs.values())))
    part = part_with_edges(images)
    columns = 1 + 2 * len(SEVERITIES)
    figure = Figure(figsize=(1.6 * columns, 1.3 * len(TRACKS)), layout="constrained")
    rows = figure.subplots(len(TRACKS), columns)
    for row, name in zip(rows, TRACKS, strict=True):
        clean, *harder = (made[part] for made in defocus_images(store, images, name))
        changes = [LARGER * (made.astype(np.int64) - clean) + 128 for made in harder]
        shown = [clean, *harder, *(np.clip(change, 0, 255) for change in changes)]
        row[0].set_ylabel(name)
        for axis, picture in zip(row, shown, strict=True):
            axis.imshow(picture.astype(np.uint8), interpolation="nearest")
            axis.set_xticks([])
            axis.set_yticks([])
    titles = ["clean", *map(str, SEVERITIES), *(f"{n} − clean, × {LARGER}" for n in SEVERITIES)]
    for axis, title in zip(rows[0], titles, strict=True):
        axis.set_title(title, fontsize="small")
    figure.savefig(out, dpi=80)


if __name__ == "__main__":
    main(*sys.argv[1:])
