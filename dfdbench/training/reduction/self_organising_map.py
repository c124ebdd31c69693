"""A one-dimensional self-organising map, trained on the Gram matrix of what it clusters.

Every neuron is an average of inputs, so that all distances follow from the products of the inputs
with each other: inputs of a hundred thousand numbers cost no more than their number squared.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import InputError

Matrix = NDArray[np.float64]
Tuning = Literal["own", "neighbours"]
TUNINGS: tuple[Tuning, ...] = get_args(Tuning)

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
    standard deviations to either side. In each of 200 epochs every input is won by the neuron at
    the smallest Euclidean distance, ties by the first; a random tenth of the wins is left out;
    every neuron becomes the mean of what was won within a radius of it, its own wins counted
    twice. The radius falls from 2 to 1 over the first 100 epochs. Neurons without input stay where
    they are.

    Parameters
    ----------
    gram : ndarray of float64, shape (k, k)
        Products of the inputs with each other.
    seed : int or tuple of int
        Of the wins that are left out.
    tuning : {"own", "neighbours"}
        After 100 epochs only a neuron's own wins count, or those of its neighbours too (a radius of
        1): sources and documentation of the toolbox that the author used disagree.

    Returns
    -------
    ndarray of intp, shape (k,)
        How many of them differ is the count of Table D.1.

    Examples
    --------
    >>> vectors = np.repeat([[0.0, 0.0], [9.0, 1.0], [-4.0, 7.0]], 4, axis=0)
    >>> len(set(winners(vectors @ vectors.T).tolist()))
    3
    """
    if tuning not in TUNINGS:
        expected = " or ".join(TUNINGS)
        raise InputError("no such tuning", where="tuning", expected=expected, got=str(tuning))
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
        Of each; at least k.
    random : Generator
        What draws it.

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
    product: Matrix = triangle @ triangle.T
    return product


@dataclass
class _Neurons:
    """The neurons, represented by products alone.

    `with_inputs` holds each neuron's products with the inputs, shape (neuron, input), `squares`
    its own square, shape (neuron,).
    """

    gram: Matrix
    with_inputs: Matrix
    squares: NDArray[np.float64]

    @classmethod
    def along_first_component(cls, gram: Matrix) -> _Neurons:
        values, vectors = np.linalg.eigh(gram)
        # An eigenvector's sign is arbitrary: the largest entry is made positive.
        first = vectors[:, -1] * np.sign(vectors[np.abs(vectors[:, -1]).argmax(), -1])
        shares = np.linspace(-_SPREAD, _SPREAD, len(gram)) / np.sqrt(len(gram))
        return cls(gram, np.outer(shares, first @ gram), shares**2 * max(values[-1], 0.0))

    def closest(self) -> NDArray[np.intp]:
        """Return the first of the closest neurons, for each input."""
        nearest: NDArray[np.intp] = (self.squares[:, None] - 2 * self.with_inputs).argmin(0)
        return nearest

    def move(self, won: NDArray[np.intp], kept: NDArray[np.intp], radius: int) -> None:
        """Move neurons to the mean of the inputs that were won within a radius, own ones twice."""
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
        # Distances are whole numbers: what lies within 1.99 lies within 1.
        return int(1 + (_FIRST_RADIUS - 1) * (1 - epoch / _ORDERING))
    return 1 if tuning == "neighbours" else 0


def _centred(gram: Matrix) -> Matrix:
    # Distances stay; the products are those of the inputs less their mean.
    means = gram.mean(axis=0)
    centred: Matrix = gram - means - means[:, None] + means.mean()
    return centred
