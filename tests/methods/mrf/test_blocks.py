from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dfdbench.errors import InputError
from dfdbench.methods.mrf import Energy, truncated_absolute
from dfdbench.methods.mrf.blocks import coarse_to_fine, coarser, finer
from tests.methods.mrf.conftest import KINDS, random_energy


@settings(max_examples=60)
@given(
    st.integers(1, 9), st.integers(1, 9), st.sampled_from(KINDS), st.booleans(), st.integers(0, 99)
)
def test_a_labeling_of_blocks_costs_what_it_costs_at_full_size(
    height: int, width: int, kind: str, weighted: bool, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    energy = random_energy(rng, height, width, 6, kind, weighted)
    blocks = coarser(energy)
    assert blocks.shape == ((height + 1) // 2, (width + 1) // 2)
    labels = rng.integers(0, 6, blocks.shape)
    assert blocks.evaluate(labels) == energy.evaluate(finer(labels, energy.shape))


def test_sums_beyond_16_bits_are_kept_in_32() -> None:
    unary = np.full((2, 2, 3), 65535, np.uint16)
    blocks = coarser(Energy(unary, truncated_absolute(3, cap=2)))
    assert blocks.unary.dtype == np.int32
    assert blocks.unary.tolist() == [[[4 * 65535] * 3]]
    assert coarser(Energy(unary // 4, truncated_absolute(3, cap=2))).unary.dtype == np.uint16


def test_sums_beyond_32_bits_are_an_error() -> None:
    unary = np.full((2, 2, 3), 2**26, np.int32)
    with pytest.raises(InputError, match="unary costs"):
        coarser(Energy(unary, truncated_absolute(3, cap=2)))


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (6, 7), (13, 8)])
def test_every_size_of_blocks_lowers_the_energy(
    rng: np.random.Generator, shape: tuple[int, int]
) -> None:
    energy = random_energy(rng, *shape, 20, "absolute", weighted=True)
    asked = []

    def begin(blocks: Energy) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
        asked.append(blocks.shape)
        return np.zeros(blocks.shape, np.int64)

    solution = coarse_to_fine(energy, begin, [(8, 4), (), (0, 2, 1)])
    assert asked == [((shape[0] + 3) // 4, (shape[1] + 3) // 4)]
    assert solution.history[0] == energy.evaluate(np.zeros(shape, int))
    assert solution.history[1] == solution.history[2]
    assert list(solution.history) == sorted(solution.history, reverse=True)
    assert solution.energy == energy.evaluate(solution.labels)
