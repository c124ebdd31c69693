"""Stores and pairs as a notebook shows them: a heading and thumbnails, in HTML."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.manifest import ALL_PAIRS, Pair
from dfdbench.datasets.pair_images import PairImages
from dfdbench.datasets.store import Store
from dfdbench.system.data_address import webp_address

#: Columns of a thumbnail, in pixels.
_WIDTH = 160
#: Of so many scenes the first pair is shown.
_SCENES = 4
_UNKNOWN = (191, 191, 191)
_QUALITY = 80

#: A thumbnail and what stands below it.
Thumbnail = tuple[str, str]


def photograph(image: NDArray[np.uint8], caption: str) -> Thumbnail:
    """Return the thumbnail of an RGB image, shape (y, x, 3)."""
    return _address(image), caption


def depth_map(
    depth: NDArray[np.uint8] | NDArray[np.float32], valid: NDArray[np.bool_], caption: str
) -> Thumbnail:
    """Return the thumbnail of a depth map, shape (y, x): far dark, near bright, grey unknown."""
    levels = np.clip(np.rint(depth), 0, 255).astype(np.uint8)
    coloured = cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)[..., ::-1]
    coloured[~valid] = _UNKNOWN
    return _address(coloured), caption


def gallery(rows: Iterable[Sequence[Thumbnail]]) -> str:
    """Return rows of thumbnails as HTML that needs no style sheet and no other file."""
    return "".join(
        '<div style="display:flex;flex-wrap:wrap;gap:8px">'
        + "".join(
            f'<figure style="margin:0 0 8px"><img src="{address}" alt="{escape(caption)}" '
            f'width="{_WIDTH}"><figcaption style="font-size:smaller;max-width:{_WIDTH}px;'
            f'overflow-wrap:anywhere">{escape(caption)}</figcaption></figure>'
            for address, caption in row
        )
        + "</div>"
        for row in rows
    )


def thumbnails(images: PairImages) -> list[Thumbnail]:
    """Return a pair's two images and its ground truth."""
    return [
        photograph(images.infocus, "in-focus"),
        photograph(images.defocus, "defocus"),
        depth_map(images.depth, images.valid, "ground truth"),
    ]


def pair_html(images: PairImages) -> str:
    """Return a pair as a notebook shows it."""
    rows, columns = images.depth.shape
    known = 100 * float(images.valid.mean())
    facts = f"{columns} × {rows} pixels, depth known at {known:.1f} % of them"
    return _heading(images.pair.id, facts) + gallery([thumbnails(images)])


def pairs_html(store: Store, pairs: Sequence[Pair]) -> str:
    """Return pairs of a store as a notebook shows them: the first of a few scenes."""
    first: dict[str, Pair] = {}
    for pair in pairs:
        first.setdefault(pair.scene, pair)
    shown = list(first.values())[:_SCENES]
    more = f", of which {len(shown)} are shown" if len(first) > len(shown) else ""
    facts = f"{len(pairs)} pairs of {len(first)} scenes{more}"
    rows = []
    for pair in shown:
        (infocus, _), *others = thumbnails(store.read(pair))
        rows.append([(infocus, f"{pair.id}, in-focus"), *others])
    return _heading(store.manifest.stem, facts) + gallery(rows)


def store_html(store: Store) -> str:
    """Return a built data set as a notebook shows it."""
    manifest = store.manifest
    splits = ", ".join(f"{split.name} ({split.pairs} pairs)" for split in manifest.splits)
    facts = {
        "what": manifest.title,
        "splits": splits or "none",
        "defocus": store.recipe_name or "captured",
        "fingerprint": store.fingerprint,
        "place": str(store.path),
    }
    listed = "".join(
        f"<tr><th style='text-align:left'>{name}</th>"
        f"<td style='text-align:left'>{escape(value)}</td></tr>"
        for name, value in facts.items()
    )
    return f"<table>{listed}</table>{pairs_html(store, store.pairs(ALL_PAIRS))}"


def _heading(name: str, facts: str) -> str:
    return f"<p><b>{escape(name)}</b><br>{escape(facts)}</p>"


def _address(image: NDArray[Any]) -> str:
    rows, columns = image.shape[:2]
    size = (_WIDTH, max(1, round(rows * _WIDTH / columns)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return webp_address(small, _QUALITY)
