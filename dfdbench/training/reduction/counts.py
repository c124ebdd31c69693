"""How many different outputs each layer of a network has, counted by maps: Table D.1."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from torch import nn

from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.store import Store
from dfdbench.errors import InputError, StoreError
from dfdbench.tables.table import Table
from dfdbench.training.reduction.self_organising_map import Tuning, noise_gram, winners
from dfdbench.training.reduction.taps import TAPS, tap

Statistic = Literal["min", "mean", "max"]
STATISTICS: tuple[Statistic, ...] = ("min", "mean", "max")
#: Layers in their order, input to output, with the classifying layer's input, 2, last.
TAPPED_LAYERS = tuple(TAPS)


@dataclass(frozen=True)
class Counts:
    """How many clusters were found, by layer, one number a sample.

    Parameters
    ----------
    filters : mapping of int to int
        How many filters each layer has.
    found : mapping of int to tuple of int
        Clusters of the layer's outputs, for each sample.
    noise : mapping of int to tuple of int
        Clusters of as many vectors of Gaussian noise, as long as the sample's feature maps.
    samples : tuple of str
        The pairs that were counted on.
    """

    filters: Mapping[int, int]
    found: Mapping[int, tuple[int, ...]]
    noise: Mapping[int, tuple[int, ...]]
    samples: tuple[str, ...]

    def widths(self, statistic: Statistic) -> dict[int, int]:
        """Return one statistic over the samples, by layer; a mean is rounded to a whole number.

        Examples
        --------
        >>> Counts({52: 8}, {52: (3, 4, 6)}, {52: (4, 4, 4)}, ("a", "b", "c")).widths("mean")
        {52: 4}
        """
        return {layer: _statistic(counts, statistic) for layer, counts in self.found.items()}


def samples_of(store: Store, split: str) -> tuple[Pair, ...]:
    """Return the first pair of each scene of a split: one sample a scene (6.2).

    Raises
    ------
    StoreError
        Where the store holds no pair of it.
    UnknownNameError
        Where there is no such split.
    """
    first: dict[str, Pair] = {}
    for pair in store.pairs(split):
        first.setdefault(pair.scene, pair)
    if not first:
        raise StoreError(
            "the store holds no pair to count on",
            where=str(store.path),
            expected=f"split {split}",
            fix="build the data set with the scenes of that split",
        )
    return tuple(first.values())


def count_clusters(
    network: nn.Module,
    store: Store,
    samples: Sequence[Pair],
    seed: int = 0,
    tuning: Tuning = "own",
    on_map: Callable[[int, int], None] | None = None,
) -> Counts:
    """Count the different winners of a map for each sample and layer, and of noise beside it.

    Parameters
    ----------
    network : nn.Module
        DfD-Net in evaluation mode.
    store : Store
        Where the samples lie.
    samples : sequence of Pair
        On which the layers' outputs are taken.
    seed : int
        Of the maps and the noise.
    tuning : {"own", "neighbours"}
        See `dfdbench.training.reduction.self_organising_map.winners`.
    on_map : callable, optional
        Called with (maps done, maps to do).

    Raises
    ------
    InputError
        Where a sample cannot be counted on, with its name and the layers.
    MethodError
        Where the network lacks a layer.
    """
    filters: dict[int, int] = {}
    found: dict[int, list[int]] = {layer: [] for layer in TAPPED_LAYERS}
    noise: dict[int, list[int]] = {layer: [] for layer in TAPPED_LAYERS}
    done = 0
    for number, pair in enumerate(samples):
        images = store.read(pair)
        try:
            tapped = tap(network, images.infocus, images.defocus)
        except InputError as error:
            raise _of_sample(error, pair) from error
        for layer, taken in tapped.items():
            filters[layer] = len(taken.gram)
            own = (seed, number, layer)
            gram = noise_gram(len(taken.gram), taken.pixels, np.random.default_rng((*own, 1)))
            found[layer].append(_different(winners(taken.gram, own, tuning)))
            noise[layer].append(_different(winners(gram, own, tuning)))
            done += 1
            if on_map:
                on_map(done, len(samples) * len(TAPPED_LAYERS))
    return Counts(
        filters,
        {layer: tuple(counts) for layer, counts in found.items()},
        {layer: tuple(counts) for layer, counts in noise.items()},
        tuple(pair.id for pair in samples),
    )


def counts_table(counts: Counts, title: str) -> Table:
    """Return the counts in the form of Table D.1, with what noise gives below them."""
    lines: list[tuple[str, dict[int, int]]] = [("filters", dict(counts.filters))]
    for name, values in (("", counts.found), ("noise, ", counts.noise)):
        for statistic in STATISTICS:
            taken = {layer: _statistic(values[layer], statistic) for layer in values}
            lines.append((f"{name}{statistic}", taken))
    columns = ("layer", *(str(layer) for layer in TAPPED_LAYERS))
    rows = tuple((name, *(str(line[layer]) for layer in TAPPED_LAYERS)) for name, line in lines)
    notes = (
        "Different winners of a self-organising map of as many neurons as filters, over "
        f"{len(counts.samples)} samples: {', '.join(counts.samples)}.",
        "A count has no zero point. The rows of noise are what the same map finds in as many "
        "independent Gaussian vectors of the same length, where nothing is redundant: a count as "
        "high says nothing against any filter.",
    )
    return Table(title, columns, rows, "l" + "r" * len(TAPPED_LAYERS), notes, frozenset({0, 3}))


def _different(won: NDArray[np.intp]) -> int:
    return len(np.unique(won))


def _statistic(counts: Sequence[int], statistic: Statistic) -> int:
    if statistic == "mean":
        # Half a filter is one: Python would round to even.
        return int(sum(counts) / len(counts) + 0.5)
    return min(counts) if statistic == "min" else max(counts)


def _of_sample(error: InputError, pair: Pair) -> InputError:
    return InputError.of(
        replace(problem, where=f"{pair.id}, {problem.where}") for problem in error.problems
    )
