"""The images of a focal stack that a method works with: one in focus everywhere, and the others."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import MethodError
from dfdbench.methods.fitted import Image, evenly_spread
from dfdbench.methods.shape_from_focus import ShapeFromFocus, focus_cells
from dfdbench.methods.view_change import ViewChange

if TYPE_CHECKING:
    from xarray import DataArray

    from dfdbench.methods.method import TrainingPair

# How many captures to check for being alike: the first, which go through the values of axes, and as
# many evenly among all, which alone might always have the same value.
_LOOKED_AT = 8
# An image is not in focus everywhere if the log contrast of others is higher by the first number,
# in more than the second share of it. Others are that much sharper in at most 2 % of it in
# synthetic stacks, whose in-focus image is sharp everywhere, and in 44 % or more in rendered ones.
_CLEARLY, _PART = 0.1, 0.1


def sharp_and_blurred(
    stack: DataArray, changes: Sequence[ViewChange] = ()
) -> tuple[Image, list[Image]]:
    """Return an image in focus everywhere, and the images to explain by blurring it, as uint8.

    If no image has the role ``infocus``, the first one returned is fused from the defocus images.
    It is also fused if several of them are sharper: even at f/8 a lens that focuses near blurs what
    is far.

    Parameters
    ----------
    stack : xarray.DataArray, dimensions (image, y, x, channel)
        A capture's ``stack``.
    changes : sequence of ViewChange
        What the camera changes in each defocus image besides the blur. It is undone before they are
        fused, but not in the images that are returned. Empty if there is no change.

    Raises
    ------
    MethodError
        If there is no defocus image.
    """
    sharp, blurred = _images_of(stack)
    if sharp is not None and len(blurred) == 1:
        return sharp, blurred
    seen = [
        np.rint(change.undone(image)).astype(np.uint8) if change.changes else image
        for change, image in zip(changes or [ViewChange()] * len(blurred), blurred, strict=True)
    ]
    if sharp is None:
        return fused(seen), blurred
    return fused([sharp, *seen]) if _others_are_sharper(sharp, seen) else sharp, blurred


def view_and_blurred(stack: DataArray) -> tuple[Image, list[Image]]:
    """Return the image that defines the view, and the defocus images: see `sharp_and_blurred`.

    The view is that of the image with the role ``infocus``, or else of the middle of the stack.
    """
    sharp, blurred = _images_of(stack)
    return blurred[len(blurred) // 2] if sharp is None else sharp, blurred


def _images_of(stack: DataArray) -> tuple[Image | None, list[Image]]:
    roles = stack["role"].values.tolist()
    values = stack.values
    images = values if values.dtype == np.uint8 else np.rint(values / 257).astype(np.uint8)
    blurred = [image for image, role in zip(images, roles, strict=True) if role != "infocus"]
    if not blurred:
        raise MethodError("no image of the stack has the role defocus", where="stack")
    return images[roles.index("infocus")] if "infocus" in roles else None, blurred


def _others_are_sharper(sharp: Image, others: Sequence[Image]) -> bool:
    """Return whether a good part of an image is sharper in others."""
    own, *contrast = (cv2.blur(focus_cells(image), (3, 3)) for image in (sharp, *others))
    return bool((np.max(contrast, axis=0) - own > _CLEARLY).mean() > _PART)


def fused(images: Sequence[Image]) -> Image:
    """Return an image that takes each pixel from the image of the stack that is sharpest there.

    The choice follows the edges of the images, as depth does in `ShapeFromFocus`.

    Parameters
    ----------
    images : sequence of ndarray of uint8, shape (y, x, channel)
        One or more.

    Examples
    --------
    >>> random = np.random.default_rng(0)
    >>> sharp = random.integers(0, 256, (40, 80, 3)).astype(np.uint8)
    >>> left, right = sharp.copy(), sharp.copy()
    >>> left[:, 40:], right[:, :40] = 128, 128
    >>> bool((fused([left, right]) == sharp).mean() > 0.9)
    True
    """
    which = ShapeFromFocus().sharpest(np.stack(images))
    whole: NDArray[Any] = np.empty_like(images[0])
    for index, image in enumerate(images):
        np.copyto(whole, image, where=(which == index)[..., np.newaxis])
    return whole


def farther_is_higher(captures: Sequence[TrainingPair]) -> bool:
    """Return whether the levels of captures grow with distance; False if that is unknown."""
    near, far = (captures[0].stack.attrs[end] for end in ("near", "far"))
    if captures[0].stack.attrs["unit"] == "levels":
        return bool(near < far)
    for capture in captures:
        metres, levels = capture.depth[capture.valid], capture.levels[capture.valid]
        if np.ptp(levels) > 0:
            return bool(levels[metres.argmax()] > levels[metres.argmin()])
    return False


def is_pair(stack: DataArray) -> bool:
    """Return whether there is one in-focus and one defocus image."""
    return sorted(stack["role"].values.tolist()) == ["defocus", "infocus"]


def require_alike(captures: Sequence[TrainingPair]) -> None:
    """Raise if captures are from different cameras, which no single law fits, or there are none."""
    if not len(captures):
        raise MethodError("no pair to calibrate with", expected="one training pair or more")
    known: dict[str, NDArray[np.float64]] = {}
    count = len(captures)
    for place in {*range(min(count, _LOOKED_AT)), *evenly_spread(count, _LOOKED_AT)}:
        stack = captures[place].stack
        facts = {} if is_pair(stack) else {"focus_depth": "focused alike"}
        facts["f_number"] = "taken at one aperture"
        for fact, how in facts.items():
            there = np.asarray(stack[fact].values[stack["role"] != "infocus"])
            alike = known.setdefault(fact, there)
            if there.shape != alike.shape or not np.allclose(there, alike, 1e-3, equal_nan=True):
                what = f"the training captures are not {how}, {alike} and {there}"
                fix = "fit to captures of one kind: a manifest with one value of that axis"
                raise MethodError(what, where=fact, fix=fix)
