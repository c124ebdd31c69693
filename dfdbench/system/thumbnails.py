"""Self-contained HTML pictures: what a notebook shows of images and depth maps."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

#: Columns of a thumbnail, in pixels.
_WIDTH = 160
_UNKNOWN = (191, 191, 191)
_QUALITY = 80

#: A thumbnail and its caption.
Thumbnail = tuple[str, str]


def photograph(image: NDArray[np.uint8], caption: str) -> Thumbnail:
    """Return the thumbnail of an RGB image, shape (y, x, 3)."""
    return _address(image), caption


def depth_map(
    depth: NDArray[np.uint8] | NDArray[np.float32], valid: NDArray[np.bool_], caption: str
) -> Thumbnail:
    """Return the thumbnail of a depth map, shape (y, x): far dark, near bright, unknown grey."""
    levels = np.clip(np.rint(np.where(valid, depth, 0)), 0, 255).astype(np.uint8)
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


def heading(name: str, facts: str) -> str:
    """Return a name in bold, and a line about it."""
    return f"<p><b>{escape(name)}</b><br>{escape(facts)}</p>"


def webp_address(image: NDArray[Any], quality: int) -> str:
    """Return an RGB image as a WebP data URL.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x, 3)
        The image.
    quality : int
        WebP's quality, 1 to 100.

    Examples
    --------
    >>> import numpy as np
    >>> webp_address(np.zeros((2, 3, 3), np.uint8), 80)[:23]
    'data:image/webp;base64,'
    """
    done, content = cv2.imencode(
        ".webp", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_WEBP_QUALITY, quality]
    )
    assert done
    return "data:image/webp;base64," + base64.b64encode(content.tobytes()).decode("ascii")


def _address(image: NDArray[Any]) -> str:
    rows, columns = image.shape[:2]
    size = (_WIDTH, max(1, round(rows * _WIDTH / columns)))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return webp_address(small, _QUALITY)
