"""What the solvers' tests share: small random energies, brute force."""

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.methods.mrf import Energy, potts, published, truncated_absolute, truncated_quadratic

SEED = 20240611


def tables(labels: int) -> dict[str, NDArray[np.int32]]:
    """Every kind of smoothness, small enough for the costs of `random_energy`."""
    return {
        "absolute": truncated_absolute(labels, cap=255, scale=2),
        "truncated-absolute": truncated_absolute(labels, cap=2, scale=3),
        "potts": potts(labels, cap=4),
        "quadratic": truncated_quadratic(labels, cap=10**6),
        "truncated-quadratic": truncated_quadratic(labels, cap=5, scale=2),
        # Thinned out, so that its one step that is not convex is among few labels too.
        "published": published(256)[np.linspace(0, 255, labels).astype(int)],
    }


KINDS = tuple(tables(4))


def random_energy(
    rng: np.random.Generator,
    height: int,
    width: int,
    labels: int,
    kind: str,
    weighted: bool = False,
    dtype: type[Any] = np.uint16,
) -> Energy:
    """Draw an energy with random costs, of the size at which both terms matter."""
    table = tables(labels)[kind]
    unary = rng.integers(0, 3 * int(table.max()) // 2 + 4, (height, width, labels)).astype(dtype)
    weights = {}
    if weighted:
        weights = {
            "weights_horizontal": rng.integers(0, 4, (height, width - 1)).astype(np.int32),
            "weights_vertical": rng.integers(0, 4, (height - 1, width)).astype(np.int32),
        }
    return Energy(unary, table, offset=int(rng.integers(0, 50)), **weights)


def all_energies(energy: Energy) -> NDArray[np.int64]:
    """Return the energy of every labeling, an axis a pixel; written apart from `evaluate`."""
    height, width = energy.shape
    # Every labeling is a column, every pixel a row.
    choices = np.indices((energy.labels,) * (height * width)).reshape(height, width, -1)
    right, down = (weights.astype(np.int64) for weights in energy.edge_weights())
    smoothness = energy.smoothness.astype(np.int64)
    total = np.full(choices.shape[-1], energy.offset, np.int64)
    for y, x in itertools.product(range(height), range(width)):
        total += energy.unary[y, x].astype(np.int64)[choices[y, x]]
        if x + 1 < width:
            total += right[y, x] * smoothness[abs(choices[y, x] - choices[y, x + 1])]
        if y + 1 < height:
            total += down[y, x] * smoothness[abs(choices[y, x] - choices[y + 1, x])]
    return total.reshape((energy.labels,) * (height * width))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(SEED)
