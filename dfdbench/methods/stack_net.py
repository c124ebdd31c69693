"""The method ``stack-net``: a network reads where along the focus each pixel is sharpest."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from dfdbench.methods.networks.inference import find_device
from dfdbench.methods.networks.stack import StackNet, places_of
from dfdbench.methods.networks.volume import mean_and_variance
from dfdbench.methods.networks.weights import open_weights
from dfdbench.methods.shape_from_focus import depth_at, focus_places

if TYPE_CHECKING:
    from xarray import DataArray

Floats = NDArray[np.float32]

# No spread is less, as a part of the focus's range.
_SMALLEST = 1e-3


def greys_of(images: NDArray[Any]) -> Floats:
    """Return images as grey whose mean over the stack is 1: shape (image, y, x).

    Examples
    --------
    >>> greys_of(np.full((3, 2, 2, 3), 40, np.uint8))[0].tolist()
    [[1.0, 1.0], [1.0, 1.0]]
    """
    greys = images.mean(axis=3, dtype=np.float32)
    return np.asarray(greys / max(greys.mean(), np.float32(1e-3)), np.float32)


class StackNetMethod:
    """Depth by a network that compares the images of a focal stack; nothing is fitted.

    All images go through the same small network, which is told at what distance each is focused. It
    was trained on rendered rooms seen by many lenses, with 3 to 10 images at drawn distances.

    Images with the role ``infocus`` are left out. The others need a `focus_depth`, three
    different ones or more, in any order and at any distances from each other.

    Parameters
    ----------
    weights : str or Path
        A file that ``dfdbench train stack-net`` wrote, or the name of shipped weights.
    sure : bool
        Also say how sure it is: the standard deviation of its distribution.
    device : str
        ``cpu``, ``cuda``, ``mps``, or ``auto`` for the fastest that there is.

    Raises
    ------
    MethodError
        Where the weights are absent, damaged, or of another architecture; at a call where the
        focus is not known, or of fewer than three images.

    Examples
    --------
    >>> StackNetMethod().trained_on
    'rooms of unseen-0 from 1000 on, focused through random lenses'
    """

    paper = (
        "Maximov et al., Focus on defocus, CVPR 2020; Yang et al., Deep depth from focus with "
        "differential focus volume, CVPR 2022, for the idea"
    )
    #: It answers in the stack's own unit.
    unit = "stack"
    #: A set of pairs is refused before a run.
    needs_stack = True

    def __init__(
        self, weights: str | Path = "unseen", sure: bool = True, device: str = "auto"
    ) -> None:
        #: Kept in results: the same name may hold other weights tomorrow.
        network, card, self.weights_sha256 = open_weights("stack-net", weights)
        assert isinstance(network, StackNet)
        self._sure, self._device = sure, find_device(device)
        self._network = network.to(self._device)
        self.trained_on = card.saw

    def __call__(self, stack: DataArray) -> Floats | tuple[Floats, Floats]:
        """Return depth in the stack's unit, float32 of shape (y, x), and how sure it is."""
        places, where = focus_places(stack, "stack-net")
        greys = greys_of(stack.values[where])
        rows, columns = greys.shape[1:]
        below, right = -rows % self._network.multiple, -columns % self._network.multiple
        padded = np.pad(greys, ((0, 0), (0, below), (0, right)), mode="edge")
        scale = np.ptp(places)
        focus = torch.from_numpy((places - places[0]) / scale).float()[np.newaxis].to(self._device)
        with torch.inference_mode():
            given = torch.from_numpy(padded)[np.newaxis].to(self._device)
            logits, mask = self._network(given, focus)
            found = mean_and_variance(logits, mask, places_of(focus))
        mean, variance = (each[0, :rows, :columns].cpu().numpy() for each in found)
        depth = depth_at(np.asarray(places[0] + scale * mean, np.float32), stack)
        if not self._sure:
            return depth
        spread = scale * np.sqrt(variance + _SMALLEST**2)
        if stack.attrs["unit"] == "metres":
            spread = spread * np.square(depth)
        return depth, np.asarray(spread, np.float32)
