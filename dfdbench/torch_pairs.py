"""The pairs of a built data set as a PyTorch data set; needs the extra ``nets``."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import Dataset

from dfdbench.datasets.captured_files import BY_IMAGE
from dfdbench.datasets.dataset import WHOLE, Region, open_dataset
from dfdbench.datasets.dataset import Dataset as Stored
from dfdbench.errors import InputError
from dfdbench.system.location import Place

__all__ = ["TorchPairs"]


class TorchPairs(Dataset[dict[str, torch.Tensor]]):
    """Pairs as tensors, whole or cropped at random places.

    Items are dictionaries: ``infocus`` and ``defocus``, uint8 (channel, y, x), or, of focal stacks,
    ``images``, (image, channel, y, x), and what is known of each; ``depth``, float32 (y, x), in
    levels or metres; ``valid``, bool (y, x), True where it is known. A ``DataLoader`` may have any
    number of workers, persistent ones too: the crops do not depend on them. To batch whole images
    of different sizes, pass ``collate_fn=TorchPairs.collate``.

    Parameters
    ----------
    name : str, Path or Dataset
        A data set's name, the path or URL of a store, or an open data set.
    split : str
        A split, a fold, a scene, or ``"all"``.
    crop : int, optional
        Side of the square crops, in pixels; whole images by default.
    seed : int
        The seed of the crops' positions.
    store, cache
        Where the data set is; see `dfdbench.datasets.dataset.open_dataset`.

    Raises
    ------
    InputError
        If the crop is larger than an image.

    Examples
    --------
    >>> data = TorchPairs("demo", "train", crop=64)  # doctest: +SKIP
    >>> loader = DataLoader(data, 8, num_workers=2, persistent_workers=True)  # doctest: +SKIP
    >>> for epoch in range(100):  # doctest: +SKIP
    ...     data.set_epoch(epoch)
    ...     for batch in loader:
    ...         ...
    """

    def __init__(
        self,
        name: Place | Stored,
        split: str = "train",
        crop: int | None = None,
        seed: int = 0,
        store: Place | None = None,
        cache: Path | str | None = None,
    ) -> None:
        data = name if isinstance(name, Stored) else open_dataset(name, store, cache=cache)
        self._pairs = data.captures(split)
        self._crop = crop
        self._seed = seed
        # Shared with a DataLoader's workers, which are copies made before the next epoch is set.
        self._epoch = torch.zeros((), dtype=torch.int64)
        self._epoch.share_memory_()  # type: ignore[no-untyped-call]
        shapes = {pair.scene for pair in self._pairs.pairs}
        smallest = min((min(self._pairs.dataset.shape_of(scene)) for scene in shapes), default=0)
        if crop is not None and not 0 < crop <= smallest:
            raise InputError(
                "crops do not fit the images",
                where="crop",
                expected=f"1 to {smallest}",
                got=str(crop),
            )

    def __len__(self) -> int:
        return len(self._pairs)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        images = self._pairs.crop(index, self._region(index))
        item = {
            "depth": torch.from_numpy(np.nan_to_num(images.depth)),
            "valid": torch.from_numpy(images.valid),
        }
        first = torch.from_numpy(np.ascontiguousarray(images.images.transpose(0, 3, 1, 2)))
        if images.is_pair:
            return item | {"infocus": first[0], "defocus": first[1]}
        known = {name: images.stack[name].values.astype(np.float32) for name in BY_IMAGE}
        return item | {"images": first} | {name: torch.from_numpy(known[name]) for name in known}

    def set_epoch(self, epoch: int) -> None:
        """Crop at this epoch's positions (epochs count from 0); call it between epochs."""
        self._epoch.fill_(epoch)

    @staticmethod
    def collate(items: Sequence[dict[str, torch.Tensor]]) -> dict[str, torch.Tensor]:
        """Return one batch of items of different sizes, for a ``DataLoader``'s ``collate_fn``.

        Images and depth maps are padded with zeros, at the bottom and on the right, to the
        largest height and width in the batch. ``valid`` is False there, so a loss over the known
        pixels leaves the padding out.

        Parameters
        ----------
        items : sequence of dict
            Items of this data set.

        Returns
        -------
        dict of str to Tensor
            What an item holds, with a first axis for the items, and ``size``, int64 (item, 2),
            each item's own rows and columns.

        Examples
        --------
        >>> image, depth = torch.ones(3, 2, 4, dtype=torch.uint8), torch.ones(2, 4)
        >>> small = {"infocus": image, "defocus": image, "depth": depth, "valid": depth > 0}
        >>> large = {name: torch.cat([values] * 2, -1) for name, values in small.items()}
        >>> batch = TorchPairs.collate([small, large])
        >>> batch["infocus"].shape, batch["valid"].sum((1, 2)).tolist(), batch["size"].tolist()
        (torch.Size([2, 3, 2, 8]), [8, 16], [[2, 4], [2, 8]])
        """
        sizes = [tuple(item["depth"].shape) for item in items]
        rows, columns = (max(extent) for extent in zip(*sizes, strict=True))

        def filled(values: torch.Tensor) -> torch.Tensor:
            if values.ndim < 2:  # a number for each image
                return values
            below, right = rows - values.shape[-2], columns - values.shape[-1]
            return torch.nn.functional.pad(values, (0, right, 0, below))

        batch = {name: torch.stack([filled(item[name]) for item in items]) for name in items[0]}
        return batch | {"size": torch.tensor(sizes)}

    def _region(self, index: int) -> Region:
        if self._crop is None:
            return WHOLE
        rows, columns = self._pairs.dataset.shape_of(self._pairs.pair_at(index).scene)
        random = np.random.default_rng((self._seed, int(self._epoch), index % len(self)))
        top = int(random.integers(0, rows - self._crop + 1))
        left = int(random.integers(0, columns - self._crop + 1))
        return slice(top, top + self._crop), slice(left, left + self._crop)
