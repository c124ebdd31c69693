"""Count the distinct outputs of each layer with self-organising maps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.errors import InputError
from dfdbench.system.parallel import OnDone, one_by_one
from dfdbench.tables.table import Table

Matrix = NDArray[np.float64]
Tuning = Literal["own", "neighbours"]
Statistic = Literal["min", "mean", "max"]
STATISTICS: tuple[Statistic, ...] = ("min", "mean", "max")
#: The module whose output is counted, by the thesis's layer, input to output (6.2): for 52, 48, 40,
#: 32, 24, 20, 12 and 8 the activation that follows, for 45, 37, 29, 17 and 5 the residual block's
#: addition, for 42, 34, 27 and 15 the convolution that halves or doubles the resolution; 2 is the
#: activation before the last layer.
TAPS: Mapping[int, str] = {
    52: "entry.activate",
    48: "encode_1.first.activate",
    45: "encode_1",
    42: "down_1",
    40: "encode_2.first.activate",
    37: "encode_2",
    34: "down_2",
    32: "bottom.first.activate",
    29: "bottom",
    27: "up_2",
    24: "merge_2.activate",
    20: "decode_2.first.activate",
    17: "decode_2",
    15: "up_1",
    12: "merge_1.activate",
    8: "decode_1.first.activate",
    5: "decode_1",
    2: "activate",
}


@dataclass(frozen=True)
class Counts:
    """How many clusters were found, by layer, one number per sample.

    Parameters
    ----------
    filters : mapping of int to int
        How many filters each layer has.
    found : mapping of int to sequence of int
        Clusters of the layer's outputs, for each sample.
    noise : mapping of int to sequence of int
        Clusters of as many vectors of Gaussian noise, as long as the sample's feature maps.
    samples : tuple of str
        The pairs that were counted on.
    """

    filters: Mapping[int, int]
    found: Mapping[int, Sequence[int]]
    noise: Mapping[int, Sequence[int]]
    samples: tuple[str, ...]

    def widths(self, statistic: Statistic) -> dict[int, int]:
        """Return one statistic over the samples, by layer; a mean is rounded to a whole number.

        Examples
        --------
        >>> Counts({52: 8}, {52: (3, 4, 6)}, {52: (4, 4, 4)}, ("a", "b", "c")).widths("mean")
        {52: 4}
        """
        return {layer: _statistic(counts, statistic) for layer, counts in self.found.items()}


def samples_of(store: Dataset, split: str) -> tuple[Pair, ...]:
    """Return the first pair of each scene of a split: one sample per scene (6.2).

    Raises
    ------
    StoreError
        If the store holds no pair of it.
    UnknownNameError
        If there is no such split.
    """
    first: dict[str, Pair] = {}
    for pair in store.some_pairs(split):
        first.setdefault(pair.scene, pair)
    return tuple(first.values())


def count_clusters(
    network: nn.Module,
    store: Dataset,
    samples: Sequence[Pair],
    seed: int = 0,
    tuning: Tuning = "own",
    on_sample: OnDone | None = None,
) -> Counts:
    """Count the distinct winners of a map for each sample and layer, and for noise beside it.

    Parameters
    ----------
    network : nn.Module
        DfD-Net in evaluation mode.
    store : Dataset
        The store of the samples.
    samples : sequence of Pair
        The pairs for which layers' outputs are computed.
    seed : int
        Seed of the maps and the noise.
    tuning : {"own", "neighbours"}
        See `dfdbench.training.reduction.counts.winners`.
    on_sample : callable, optional
        Called with (samples done, total samples).

    Raises
    ------
    InputError
        If a sample cannot be used; the error names it and the layer.
    """
    filters: dict[int, int] = {}
    found: dict[int, list[int]] = {layer: [] for layer in TAPS}
    noise: dict[int, list[int]] = {layer: [] for layer in TAPS}
    for number, pair in enumerate(one_by_one(samples, on_sample)):
        images = store.read(pair).two_of(store.manifest.pair_images)
        tapped = tap(network, images.infocus, images.defocus, f"{pair.id}, ")
        for layer, (products, pixels) in tapped.items():
            filters[layer] = len(products)
            own = (seed, number, layer)
            random = noise_gram(len(products), pixels, np.random.default_rng((*own, 1)))
            for counts, gram in ((found, products), (noise, random)):
                counts[layer].append(np.unique(winners(gram, own, tuning)).size)
    return Counts(filters, found, noise, tuple(pair.id for pair in samples))


def counts_table(counts: Counts, title: str) -> Table:
    """Return the counts in the form of Table D.1, with the counts for noise below."""
    lines: list[tuple[str, dict[int, int]]] = [("filters", dict(counts.filters))]
    for name, values in (("", counts.found), ("noise, ", counts.noise)):
        for statistic in STATISTICS:
            taken = {layer: _statistic(values[layer], statistic) for layer in values}
            lines.append((f"{name}{statistic}", taken))
    columns = ("layer", *(str(layer) for layer in TAPS))
    rows = tuple((name, *(str(line[layer]) for layer in TAPS)) for name, line in lines)
    notes = (
        "Different winners of a self-organising map of as many neurons as filters, over "
        f"{len(counts.samples)} samples: {', '.join(counts.samples)}.",
        "A count has no zero point. The rows of noise are what the same map finds in as many "
        "independent Gaussian vectors of the same length, where nothing is redundant: a count as "
        "high says nothing against any filter.",
    )
    return Table(title, columns, rows, "l", notes, frozenset({0, 3}))


def _statistic(counts: Sequence[int], statistic: Statistic) -> int:
    if statistic == "mean":
        # Round half up: Python would round half to even.
        return int(sum(counts) / len(counts) + 0.5)
    return min(counts) if statistic == "min" else max(counts)


def tap(
    network: nn.Module, infocus: NDArray[np.uint8], defocus: NDArray[np.uint8], place: str = ""
) -> dict[int, tuple[Matrix, int]]:
    """Return the products of each layer's outputs for a pair, by layer.

    Parameters
    ----------
    network : nn.Module
        In evaluation mode, its batch normalization not folded; on any device.
    infocus, defocus : ndarray of uint8, shape (y, x, 3)
        RGB. Cropped at the lower and right edge to the network's multiple, so that no padding
        counts.
    place : str, optional
        A prefix for errors: whose images they are.

    Returns
    -------
    dict of int to (ndarray, int)
        Products of the feature maps with each other, neither centred nor normalised: float64,
        shape (filter, filter); and the pixels of a feature map.

    Raises
    ------
    InputError
        If a layer's outputs have fewer pixels than there are filters.
    """
    found: dict[int, tuple[Matrix, int]] = {}
    multiple = int(network.multiple)  # type: ignore[arg-type]
    rows, columns = (extent // multiple * multiple for extent in infocus.shape[:2])
    both = np.concatenate([infocus, defocus], axis=2)[:rows, :columns].transpose(2, 0, 1)
    device = next(network.parameters()).device
    image = torch.from_numpy(np.ascontiguousarray(both))[None].to(device).float()

    def keep(layer: int, _module: nn.Module, _given: tuple[Tensor, ...], maps: Tensor) -> None:
        vectors = maps[0].flatten(1).cpu().double()
        found[layer] = (vectors @ vectors.T).numpy(), vectors.shape[1]

    with ExitStack() as hooks, torch.inference_mode():
        for layer, path in TAPS.items():
            module = network.get_submodule(path)
            hooks.enter_context(module.register_forward_hook(partial(keep, layer)))
        network(image)
    # Modules are called in their own order, which may differ from that of the layers.
    found = {layer: found[layer] for layer in TAPS}
    for layer, (gram, pixels) in found.items():
        if pixels < len(gram):
            what = f"fewer pixels than filters in a feature map, {pixels} of {len(gram)}"
            raise InputError(what, where=f"{place}layer {layer}", fix="take larger images")
    return found


_EPOCHS = 200
_ORDERING = 100
_FIRST_RADIUS = 2.0
_LEFT_OUT = 0.1
_SPREAD = 2.5


def winners(
    gram: Matrix, seed: int | tuple[int, ...] = 0, tuning: Tuning = "own"
) -> NDArray[np.intp]:
    """Return the winning neuron of each input, after training with as many neurons as inputs.

    Kohonen's map as the author of the thesis trained it (App. D.1): K neurons in a row, with the
    distance ``|i - j|`` between them, start along the inputs' first principal component, over 2.5
    standard deviations to either side. In each of 200 epochs, the closest neuron (Euclidean
    distance; the first in a tie) wins each input, and a random tenth of the wins is left out. Then
    every neuron becomes the mean of the inputs that were won within a radius of it, with its own
    wins counted twice. The radius falls from 2 to 1 over the first 100 epochs. Neurons without
    input stay where they are.

    Parameters
    ----------
    gram : ndarray of float64, shape (k, k)
        Products of the inputs with each other.
    seed : int or tuple of int
        Seed of the omitted wins.
    tuning : {"own", "neighbours"}
        After 100 epochs, count only a neuron's own wins, or also those of its neighbours (a radius
        of 1): sources and documentation of the author's toolbox disagree.

    Returns
    -------
    ndarray of intp, shape (k,)
        The number of distinct winners is the count of Table D.1.

    Examples
    --------
    >>> vectors = np.repeat([[0.0, 0.0], [9.0, 1.0], [-4.0, 7.0]], 4, axis=0)
    >>> len(set(winners(vectors @ vectors.T).tolist()))
    3
    """
    neurons = _Neurons.along_first_component(_centred(gram))
    random = np.random.default_rng(seed)
    for epoch in range(_EPOCHS):
        won = neurons.closest()
        kept = np.flatnonzero(random.random(won.size) >= _LEFT_OUT)
        neurons.move(won, kept, _radius(epoch, tuning))
    return neurons.closest()


def noise_gram(inputs: int, length: int, random: np.random.Generator) -> Matrix:
    """Return the Gram matrix of independent standard Gaussian vectors, drawn without the vectors.

    It has the Wishart distribution: by Bartlett's decomposition, the product of a triangle of
    normal and chi-distributed numbers with itself.

    Parameters
    ----------
    inputs : int
        How many vectors, k.
    length : int
        The length of each; at least k.
    random : Generator
        The generator for the draw.

    Returns
    -------
    ndarray of float64, shape (k, k)

    Examples
    --------
    >>> gram = noise_gram(3, 10_000, np.random.default_rng(0))
    >>> bool(np.abs(gram / 10_000 - np.eye(3)).max() < 0.05)
    True
    """
    triangle = np.tril(random.standard_normal((inputs, inputs)), -1)
    triangle[np.diag_indices(inputs)] = np.sqrt(random.chisquare(length - np.arange(inputs)))
    return np.asarray(triangle @ triangle.T)


@dataclass
class _Neurons:
    """The neurons, represented only by products.

    `with_inputs` holds each neuron's products with the inputs, shape (neuron, input); `squares`
    holds its product with itself, shape (neuron,).
    """

    gram: Matrix
    with_inputs: Matrix
    squares: NDArray[np.float64]

    @classmethod
    def along_first_component(cls, gram: Matrix) -> _Neurons:
        values, vectors = np.linalg.eigh(gram)
        # An eigenvector's sign is arbitrary, so make the largest entry positive.
        first = vectors[:, -1] * np.sign(vectors[np.abs(vectors[:, -1]).argmax(), -1])
        shares = np.linspace(-_SPREAD, _SPREAD, len(gram)) / np.sqrt(len(gram))
        return cls(gram, np.outer(shares, first @ gram), shares**2 * max(values[-1], 0.0))

    def closest(self) -> NDArray[np.intp]:
        """Return the first of the closest neurons, for each input."""
        return np.asarray((self.squares[:, None] - 2 * self.with_inputs).argmin(0))

    def move(self, won: NDArray[np.intp], kept: NDArray[np.intp], radius: int) -> None:
        """Move neurons to the mean of the inputs won within a radius, counting their own twice."""
        wins = np.zeros_like(self.gram)
        wins[won[kept], kept] = 1
        shares = 2 * wins
        for distance in range(1, radius + 1):
            shares[distance:] += wins[:-distance]
            shares[:-distance] += wins[distance:]
        total = shares.sum(axis=1)
        moved = np.flatnonzero(total)
        means = shares[moved] / total[moved, None]
        self.with_inputs[moved] = means @ self.gram
        self.squares[moved] = (means * self.with_inputs[moved]).sum(axis=1)


def _radius(epoch: int, tuning: Tuning) -> int:
    if epoch < _ORDERING:
        # Distances are whole numbers: within 1.99 means within 1.
        return int(1 + (_FIRST_RADIUS - 1) * (1 - epoch / _ORDERING))
    return 1 if tuning == "neighbours" else 0


def _centred(gram: Matrix) -> Matrix:
    # Distances stay the same; these are the products of the inputs minus their mean.
    means = gram.mean(axis=0)
    return np.asarray(gram - means - means[:, None] + means.mean())
