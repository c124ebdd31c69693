"""Apply a network to images of any size: in tiles, with the last layer a few rows at a time."""

import math
from collections.abc import Callable, Iterator
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import MethodError
from dfdbench.methods.networks.architectures import fold_batch_norm

Precision = Literal["float32", "bf16"]
PRECISIONS: tuple[Precision, ...] = ("float32", "bf16")
Readout = Literal["mode", "median"]
READOUTS: tuple[Readout, ...] = ("mode", "median")
# How logits, shape (y, x, level), are read.
Read = Callable[[Tensor], Tensor]
# Parts of the levels whose shares are read, and the share that each has at the least.
_PARTS, _RARE = 64, 1e-4
_SMALLEST_TILE = 64
#: The most memory that a network may use at a time beside its weights, in bytes.
_MOST_BYTES = 400_000_000
# Measured: how many float32 arrays as wide as the first and last layers are held at a time.
_HELD = 8
# A row of a megapixel has a megabyte of logits, so this many rows fit in the processor's caches.
_ROWS_AT_A_TIME = 16


def find_device(name: str) -> torch.device:
    """Return the device with this name; ``auto`` is CUDA, else MPS, else the CPU.

    Raises
    ------
    MethodError
        If there is no such device.

    Examples
    --------
    >>> find_device("cpu")
    device(type='cpu')
    """
    usable = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available()}
    known = ["auto", *(kind for kind, there in usable.items() if there), "cpu"]
    if name not in known:
        expected = ", ".join(known)
        raise MethodError("no such device here", where="device", expected=expected, got=name)
    return torch.device(known[1] if name == "auto" else name)


class Predictor:
    """Depth levels of image pairs from a network.

    Images are padded by reflection to the network's multiple and cut into overlapping tiles. The
    overlap covers everything that a pixel's answer depends on, so tiles do not change the answer.
    Logits, 256 per pixel, are held for only a few rows at a time.

    Parameters
    ----------
    network : DfDNet or UNet
        A network in evaluation mode; its batch normalization is folded in place.
    device : torch.device
        Where it runs.
    precision : {"float32", "bf16"}
        The precision of the convolutions.
    tile : int, optional
        Rows and columns of a tile, without its overlap; by default as many as fit in 400 MB beside
        the network's weights.
    readout : {"mode", "median"}
        Which level of a pixel's distribution over all levels is the answer: the likeliest, as in
        the thesis, or the median. Where there is no texture, the distribution has several peaks,
        and the likeliest level may be far off.

    Raises
    ------
    MethodError
        If precision or readout is unknown, or the tile is too small.
    """

    def __init__(
        self,
        network: nn.Module,
        device: torch.device,
        precision: Precision = "float32",
        tile: int | None = None,
        readout: Readout = "mode",
    ) -> None:
        for name, got, known in (
            ("precision", precision, PRECISIONS),
            ("readout", readout, READOUTS),
        ):
            if got not in known:
                expected = " or ".join(known)
                raise MethodError("wrong parameter", where=name, expected=expected, got=str(got))
        if tile is not None and (not isinstance(tile, int) or tile < _SMALLEST_TILE):
            what = f"a tile has at least {_SMALLEST_TILE} pixels, not {tile}"
            raise MethodError(what, where="tile")
        folded: Any = fold_batch_norm(network).to(device)
        folded = folded.to(memory_format=torch.channels_last)
        self._hidden, self._classify = folded.hidden, folded.classify
        self._device = device
        self._bf16 = precision == "bf16"
        self._read = likeliest_levels if readout == "mode" else median_levels
        self._multiple: int = folded.multiple
        self._margin: int = -(-folded.margin // self._multiple) * self._multiple
        widest = max(folded.first.out_channels, folded.classify.in_channels)
        self._most_pixels: int = _MOST_BYTES // (4 * _HELD * widest)
        self._tile = tile

    def __call__(self, infocus: NDArray[np.uint8], defocus: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return levels, shape (y, x), for two RGB images, shape (y, x, 3)."""
        return self._answer(infocus, defocus, self._read)

    def log_shares(
        self, infocus: NDArray[np.uint8], defocus: NDArray[np.uint8]
    ) -> NDArray[np.float16]:
        """Return the logarithm of the probability of each of 64 parts of the levels, (y, x, 64).

        None is below that of 1e-4, so that one pixel cannot rule out a depth.
        """
        return self._answer(infocus, defocus, log_shares)

    def _answer(
        self, infocus: NDArray[np.uint8], defocus: NDArray[np.uint8], read: Read
    ) -> NDArray[Any]:
        height, width = infocus.shape[:2]
        below, right = -height % self._multiple, -width % self._multiple
        pixels = np.concatenate([infocus, defocus], axis=2)
        padded = np.pad(pixels, ((0, below), (0, right), (0, 0)), mode="reflect")
        like = read(torch.zeros(1, 1, LEVELS)).numpy()
        whole = np.empty((*padded.shape[:2], *like.shape[2:]), like.dtype)
        step = (self._tile or self._affordable_tile(padded)) // self._multiple * self._multiple
        for rows, seen_rows, y in _spans(padded.shape[0], step, self._margin):
            for columns, seen_columns, x in _spans(padded.shape[1], step, self._margin):
                whole[rows, columns] = self._forward(padded[seen_rows, seen_columns], read)[y, x]
        return whole[:height, :width]

    def _affordable_tile(self, padded: NDArray[np.uint8]) -> int:
        rows, columns = map(int, padded.shape[:2])
        if rows * columns <= self._most_pixels:
            return max(rows, columns)
        # Not so small that most of the work is overlap.
        return max(math.isqrt(self._most_pixels) - 2 * self._margin, 4 * self._margin)

    def _forward(self, pixels: NDArray[np.uint8], read: Read) -> NDArray[Any]:
        # The image already has channels last, so this is a view, in the fastest layout.
        given = torch.from_numpy(np.ascontiguousarray(pixels)[np.newaxis]).permute(0, 3, 1, 2)
        with (
            torch.inference_mode(),
            torch.autocast(self._device.type, torch.bfloat16, enabled=self._bf16),
        ):
            hidden = self._hidden(given.to(self._device).float())
            found, margin = [], self._classify.kernel_size[0] // 2
            for _, seen, y in _spans(len(pixels), _ROWS_AT_A_TIME, margin):
                logits = self._classify(hidden[:, :, seen])[0].permute(1, 2, 0)
                found.append(read(logits[y]))
        return np.asarray(torch.cat(found).cpu().numpy())


def likeliest_levels(logits: Tensor) -> Tensor:
    """Return the likeliest level of each pixel, uint8 (y, x), for logits (y, x, level).

    Examples
    --------
    >>> likeliest_levels(torch.tensor([[[5.0, 4.0, 4.9]]])).item()
    0
    """
    return logits.argmax(-1).to(torch.uint8)


def median_levels(logits: Tensor) -> Tensor:
    """Return the median of each pixel's distribution, uint8 (y, x), for logits (y, x, level).

    It is the lowest level up to which the probability sums to at least half; of all levels it has
    the smallest expected absolute error.

    Examples
    --------
    >>> median_levels(torch.tensor([[[5.0, 4.0, 4.9]]])).item()
    1
    """
    below = logits.float().softmax(-1).cumsum_(-1)
    return below[..., :-1].lt_(0.5).sum(-1).to(torch.uint8)


def log_shares(logits: Tensor) -> Tensor:
    """Return what `Predictor.log_shares` does, float16 (y, x, part), for logits (y, x, level).

    Examples
    --------
    >>> log_shares(torch.zeros(1, 1, 256)).unique().exp().tolist()
    [0.0157318115234375]
    """
    shares = logits.float().softmax(-1)
    parts = shares.view(*shares.shape[:2], _PARTS, -1).sum(-1)
    return parts.add_(_RARE).log_().half()


class LevelsOfImages(nn.Module):
    """A network and its readout as one, as `dfdbench.export_onnx` writes them."""

    def __init__(self, network: nn.Module, readout: Readout) -> None:
        super().__init__()
        self.network = fold_batch_norm(network)
        self.read = likeliest_levels if readout == "mode" else median_levels

    def forward(self, infocus: Tensor, defocus: Tensor) -> Tensor:
        """Return depth levels, float (1, y, x), for images 0 to 255, float (1, 3, y, x)."""
        logits = self.network(torch.cat((infocus, defocus), 1))
        return self.read(logits.permute(0, 2, 3, 1)).float()


def _spans(length: int, step: int, margin: int) -> Iterator[tuple[slice, slice, slice]]:
    # The span to answer, the span to look at for it, and where the first is within the second.
    for start in range(0, length, step):
        stop, first = min(start + step, length), max(0, start - margin)
        seen = slice(first, min(length, stop + margin))
        yield slice(start, stop), seen, slice(start - first, stop - first)
