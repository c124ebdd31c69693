"""Pictures as text that stands in a page: data addresses."""

from __future__ import annotations

import base64
from typing import Any

import cv2
from numpy.typing import NDArray


def webp_address(image: NDArray[Any], quality: int) -> str:
    """Return an RGB image as a data address of WebP.

    Parameters
    ----------
    image : ndarray of uint8, shape (y, x, 3)
        The image.
    quality : int
        1 to 100, as of WebP.

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
