"""The pairs of a built data set as a PyTorch data set; needs the extra ``nets``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch.utils.data import Dataset

from dfdbench.errors import InputError, Problem
from dfdbench.location import Place
from dfdbench.reading import open_pairs
from dfdbench.store import WHOLE, Region


class TorchPairs(Dataset[dict[str, torch.Tensor]]):
    """Pairs as tensors, whole or cropped at random places.

    Items are dictionaries: ``infocus`` and ``defocus``, uint8 (channel, y, x); ``depth``, uint8
    (y, x), depth levels; ``valid``, bool (y, x), where they are known. It may be used with any
    number of a ``DataLoader``'s workers: the crops do not depend on it.

    Parameters
    ----------
    name : str
        A data set's name, or the path or URL of a store.
    split : str
        A split, a fold, a scene, or ``"all"``.
    crop : int, optional
        Rows and columns of the crops; whole images by default.
    seed : int
        Of the places of the crops.
    store, cache
        Where the data set lies; see `dfdbench.store.open_store`.

    Raises
    ------
    InputError
        Where a crop is larger than the images.
    """

    def __init__(
        self,
        name: str,
        split: str = "train",
        crop: int | None = None,
        seed: int = 0,
        store: Place | None = None,
        cache: Path | None = None,
    ) -> None:
        self._pairs = open_pairs(name, split, store, cache)
        self._crop = crop
        self._seed = seed
        self._epoch = 0
        shapes = {pair.scene for pair in self._pairs.pairs}
        smallest = min((min(self._pairs.store.shape_of(scene)) for scene in shapes), default=0)
        if crop is not None and not 0 < crop <= smallest:
            raise InputError(
                Problem("crops do not fit the images", "crop", f"1 to {smallest}", str(crop))
            )

    def __len__(self) -> int:
        return len(self._pairs)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        images = self._pairs.crop(index, self._region(index))
        return {
            "infocus": torch.from_numpy(np.ascontiguousarray(images.infocus.transpose(2, 0, 1))),
            "defocus": torch.from_numpy(np.ascontiguousarray(images.defocus.transpose(2, 0, 1))),
            "depth": torch.from_numpy(images.depth),
            "valid": torch.from_numpy(images.valid),
        }

    def set_epoch(self, epoch: int) -> None:
        """Crop at other places: those of this epoch, a number from 0."""
        self._epoch = epoch

    def _region(self, index: int) -> Region:
        if self._crop is None:
            return WHOLE
        rows, columns = self._pairs.store.shape_of(self._pairs.pairs[index].scene)
        random = np.random.default_rng((self._seed, self._epoch, index % len(self)))
        top = int(random.integers(0, rows - self._crop + 1))
        left = int(random.integers(0, columns - self._crop + 1))
        return slice(top, top + self._crop), slice(left, left + self._crop)
