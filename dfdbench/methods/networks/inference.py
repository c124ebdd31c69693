"""A network's answer for images of any size, in tiles where memory is short."""

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dfdbench.errors import MethodError
from dfdbench.methods.networks.architectures import fold_batch_norm

Precision = Literal["float32", "bf16"]
PRECISIONS: tuple[Precision, ...] = ("float32", "bf16")
Readout = Literal["mode", "median"]
READOUTS: tuple[Readout, ...] = ("mode", "median")
_SMALLEST_TILE = 64
_OUT_OF_MEMORY = ("out of memory", "not enough memory", "can't allocate memory")


def find_device(name: str) -> torch.device:
    """Return the device of a name; ``auto`` is CUDA, else MPS, else the CPU.

    Raises
    ------
    MethodError
        If there is no such device.

    Examples
    --------
    >>> find_device("cpu")
    device(type='cpu')
    """
    there = ["cpu"]
    if torch.backends.mps.is_available():
        there.insert(0, "mps")
    if torch.cuda.is_available():
        there.insert(0, "cuda")
    if name == "auto":
        return torch.device(there[0])
    if name not in there:
        raise MethodError(
            "no such device here", where="device", expected=", ".join(["auto", *there]), got=name
        )
    return torch.device(name)


class Predictor:
    """Depth levels of image pairs from a network.

    Images are padded by reflection to the network's multiple. Where `tile` is given, or memory
    does not suffice, they are cut into overlapping tiles; since the overlap covers all that a
    pixel's answer depends on, tiles do not change the answer.

    Parameters
    ----------
    network : nn.Module
        In evaluation mode; its batch normalization is folded in place.
    device : torch.device
        If it runs.
    precision : {"float32", "bf16"}
        Of the convolutions.
    tile : int, optional
        Rows and columns of a tile, without its overlap.
    readout : {"mode", "median"}
        Which level of a pixel's distribution over all levels is the answer: the likeliest, as in
        the thesis, or the one with half of the probability below it. Where there is no texture
        the distribution has several peaks, and the likeliest level may lie far off.

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
        _require_one_of(PRECISIONS, precision, "precision")
        _require_one_of(READOUTS, readout, "readout")
        if tile is not None and (not isinstance(tile, int) or tile < _SMALLEST_TILE):
            raise MethodError(
                f"a tile has at least {_SMALLEST_TILE} pixels, not {tile}", where="tile"
            )
        folded = fold_batch_norm(network).to(device)
        self._network = folded.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._device = device
        self._bf16 = precision == "bf16"
        self._read = likeliest_levels if readout == "mode" else median_levels
        self._multiple = int(network.multiple)  # type: ignore[arg-type]
        self._margin = int(network.margin)  # type: ignore[arg-type]
        #: The tile in use; None while images are taken whole.
        self.tile = tile

    def __call__(self, infocus: NDArray[np.uint8], defocus: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return levels, shape (y, x), for two RGB images, shape (y, x, 3).

        Raises
        ------
        MemoryError
            If not even the smallest tile fits.
        """
        rows, columns = infocus.shape[:2]
        below, right = -rows % self._multiple, -columns % self._multiple
        pixels = np.concatenate([infocus, defocus], axis=2)
        padded = np.pad(pixels, ((0, below), (0, right), (0, 0)), mode="reflect")
        while True:
            try:
                return self._levels(padded)[:rows, :columns]
            except RuntimeError as error:
                if not any(text in str(error).lower() for text in _OUT_OF_MEMORY):
                    raise
                smaller = (self.tile or 2 * _power_of_two(max(padded.shape[:2]))) // 2
                if smaller < _SMALLEST_TILE:
                    raise MemoryError("not enough memory for the smallest tile") from error
                self.tile = smaller

    def _levels(self, padded: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if self.tile is None:
            return self._forward(padded)
        levels = np.empty(padded.shape[:2], np.uint8)
        step = self.tile // self._multiple * self._multiple
        margin = -(-self._margin // self._multiple) * self._multiple
        for rows, outer_rows in _spans(padded.shape[0], step, margin):
            for columns, outer_columns in _spans(padded.shape[1], step, margin):
                answer = self._forward(padded[outer_rows, outer_columns])
                levels[rows, columns] = answer[
                    rows.start - outer_rows.start : rows.stop - outer_rows.start,
                    columns.start - outer_columns.start : columns.stop - outer_columns.start,
                ]
        return levels

    def _forward(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        # Channels come last in the image already: this is a view, and what convolutions like best.
        given = torch.from_numpy(np.ascontiguousarray(pixels)[np.newaxis]).permute(0, 3, 1, 2)
        with (
            torch.inference_mode(),
            torch.autocast(self._device.type, torch.bfloat16, enabled=self._bf16),
        ):
            logits = self._network(given.to(self._device).float())
            levels = self._read(logits[0])
        answer: NDArray[np.uint8] = levels.cpu().numpy()
        return answer


def likeliest_levels(logits: Tensor) -> Tensor:
    """Return the likeliest level of each pixel, uint8 (y, x), for logits (level, y, x).

    Examples
    --------
    >>> likeliest_levels(torch.tensor([5.0, 4.0, 4.9])[:, None, None]).item()
    0
    """
    return logits.argmax(0).to(torch.uint8)


def median_levels(logits: Tensor) -> Tensor:
    """Return the median of each pixel's distribution, uint8 (y, x), for logits (level, y, x).

    The lowest level up to which at least half of the probability lies; of all levels it has the
    smallest expected absolute error.

    Examples
    --------
    >>> median_levels(torch.tensor([5.0, 4.0, 4.9])[:, None, None]).item()
    1
    """
    below = logits.float().softmax(0).cumsum(0)
    return (below[:-1] < 0.5).sum(0, dtype=torch.uint8)


def _require_one_of(choices: Sequence[str], got: object, name: str) -> None:
    if got not in choices:
        expected = " or ".join(choices)
        raise MethodError("wrong parameter", where=name, expected=expected, got=str(got))


def _spans(length: int, step: int, margin: int) -> Iterator[tuple[slice, slice]]:
    for start in range(0, length, step):
        stop = min(start + step, length)
        yield slice(start, stop), slice(max(0, start - margin), min(length, stop + margin))


def _power_of_two(number: int) -> int:
    return 1 << (number - 1).bit_length() if number > 1 else 1
