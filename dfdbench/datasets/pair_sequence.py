"""Read the pairs of a built data set, one by one, as they are asked for."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from pathlib import Path
from typing import overload

import xarray

from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.pair_images import PairImages
from dfdbench.datasets.store import WHOLE, Region, Store, open_store
from dfdbench.errors import InputError, Problem
from dfdbench.system.location import Place


class PairSequence(Sequence[PairImages]):
    """The pairs of a split; each is read when it is asked for, and none is kept.

    Parameters
    ----------
    store : Store
        The data set.
    pairs : tuple of Pair
        Which of its pairs.
    """

    def __init__(self, store: Store, pairs: tuple[Pair, ...]) -> None:
        self.store = store
        self.pairs = pairs

    def __len__(self) -> int:
        return len(self.pairs)

    @overload
    def __getitem__(self, index: int) -> PairImages: ...

    @overload
    def __getitem__(self, index: slice) -> PairSequence: ...

    def __getitem__(self, index: int | slice) -> PairImages | PairSequence:
        if isinstance(index, slice):
            return PairSequence(self.store, self.pairs[index])
        return self.store.read(self.pair_at(index))

    def __repr__(self) -> str:
        return f"<{len(self)} pairs of {self.store.path}>"

    def _repr_html_(self) -> str:
        from dfdbench.datasets.notebook import pairs_html

        return pairs_html(self.store, self.pairs)

    def pair_at(self, index: int) -> Pair:
        """Return which pair is at a place, without reading it.

        Raises
        ------
        IndexError
            Where there are fewer.
        TypeError
            Where it is no whole number.
        """
        try:
            place = operator.index(index)
        except TypeError:
            raise TypeError(
                f"a pair is found by its place, as data[0]; got {index!r}. Names: data.pairs"
            ) from None
        try:
            return self.pairs[place]
        except IndexError:
            raise IndexError(f"no pair {index}: {self!r} has 0 to {len(self) - 1}") from None

    def crop(self, index: int, region: Region = WHOLE) -> PairImages:
        """Return a region of one pair, decoding no other pair's images.

        Parameters
        ----------
        index : int
            Which pair.
        region : pair of slice
            Rows and columns, within the image.

        Raises
        ------
        InputError
            Where the region is not two slices, reaches beyond the image, or holds no pixel.
        IndexError
            Where there are fewer pairs.
        """
        parts = region if isinstance(region, tuple) else ()
        if [type(part) for part in parts] != [slice, slice]:
            raise InputError(
                "not a region",
                where="region",
                expected="two slices: rows, columns",
                got=repr(region),
            )
        pair = self.pair_at(index)
        _check_region(region, self.store.shape_of(pair.scene))
        return self.store.read(pair, region)

    def scene(self, name: str) -> xarray.Dataset:
        """Return all of a scene as lazily read arrays with named dimensions."""
        return self.store.to_xarray(name)


def _check_region(region: Region, shape: tuple[int, int]) -> None:
    # Slices beyond an end are cut there by Python's rule, and those that start before 0 empty.
    problems = [
        Problem(
            "the crop does not lie within the image",
            where=axis,
            expected=f"pixels 0 to {size}, start first",
            got=f"{part.start} to {part.stop}",
        )
        for axis, part, size in zip(("rows", "columns"), region, shape, strict=True)
        if any(end is not None and not -size <= end <= size for end in (part.start, part.stop))
        or not range(*part.indices(size))
    ]
    if problems:
        raise InputError.of(problems)


def open_pairs(
    name: str, split: str = "all", store: Place | None = None, cache: Path | None = None
) -> PairSequence:
    """Open a built data set's pairs; this is ``dfdbench.open``.

    Parameters
    ----------
    name : str
        A data set's name, or the path or URL of a store.
    split : str
        A split, a fold, a scene, or ``"all"``.
    store, cache
        Where it lies, if not in the default place; see `dfdbench.datasets.store.open_store`.

    Returns
    -------
    PairSequence
        Its items are `PairImages`: ``infocus``, ``defocus``, ``depth``, ``valid``, ``pair``.

    Raises
    ------
    StoreError
        Where the data set is not built.
    UnknownNameError
        Where there is no such data set or split.
    """
    opened = open_store(name, store, cache)
    return PairSequence(opened, opened.pairs(split))
