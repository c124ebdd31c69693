import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dfdbench.methods import mrf
from dfdbench.methods.mrf.moves import Mover, expansion_offer
from dfdbench.methods.mrf.solvers import coarse_to_fine, coarser, finer
from tests.methods.mrf.conftest import KINDS, all_energies, random_energy

SOLVERS: dict[str, Callable[[mrf.Energy], mrf.Solution]] = {
    "expansion": mrf.expansion,
    "fast": lambda energy: mrf.split(energy, "fast"),
    "default": mrf.split,
    "high": lambda energy: mrf.split(energy, "high"),
}


def test_solutions_are_consistent_and_bounded(rng: np.random.Generator) -> None:
    for solve, kind, weighted in itertools.product(SOLVERS.values(), KINDS, [False, True] * 3):
        energy = random_energy(rng, 2, 3, 4, kind, weighted)
        before = energy.unary.copy()
        least = all_energies(energy).min()
        solution = solve(energy)
        assert solution.labels.shape == (2, 3)
        assert solution.labels.dtype == np.uint8
        assert isinstance(solution.energy, int)
        assert solution.energy == energy.evaluate(solution.labels) == solution.history[-1]
        assert list(solution.history) == sorted(solution.history, reverse=True)
        assert solution.energy >= least
        assert np.array_equal(before, energy.unary)


@pytest.mark.slow
def test_cost_types_agree(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 5, 6, 8, "absolute", dtype=np.int32)
    twin = mrf.Energy(energy.unary.astype(np.uint16), energy.smoothness, offset=energy.offset)
    for solve in (mrf.expansion, mrf.split):
        assert solve(energy).history == solve(twin).history


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("most_bytes", [1, 2000])
def test_costs_in_parts_give_the_same_solution(
    rng: np.random.Generator, solver: str, kind: str, most_bytes: int
) -> None:
    held = random_energy(rng, 9, 11, 20, kind, weighted=True)
    seen = list[tuple[int, ...]]()

    def of(rows: slice, columns: slice) -> tuple[Any, int]:
        part = np.ascontiguousarray(held.unary[rows, columns])
        seen.append(part.shape)
        return part, int(part.sum())

    parts = mrf.Parts(of, held.unary.shape, held.largest_cost, most_bytes)
    assert parts.offset() == held.unary.sum()
    energy = replace(held, unary=parts)
    seen.clear()
    mine, theirs = SOLVERS[solver](energy), SOLVERS[solver](held)
    assert np.array_equal(mine.labels, theirs.labels)
    assert mine.history == theirs.history
    assert energy.evaluate(mine.labels) == mine.energy
    # Blocks first, and then never the whole; other ways need it.
    blocks = solver != "expansion" and kind == "absolute"
    assert ((9, 11, 20) in seen) != blocks


def test_two_labels_are_solved_exactly_and_many_and_single_pixels(rng: np.random.Generator) -> None:
    wide = random_energy(rng, 1, 3, 300, "absolute")
    single = mrf.Energy(np.array([[[5, 3, 0, 4]]], np.uint16), mrf.truncated_absolute(4, cap=9))
    for solve in SOLVERS.values():
        assert solve(wide).labels.dtype == np.uint16
        assert solve(single).labels.tolist() == [[2]]
        for _ in range(10):
            energy = random_energy(rng, 3, 4, 2, "absolute", weighted=True)
            assert solve(energy).energy == all_energies(energy).min()


def test_split_is_near_expansion_if_convex(rng: np.random.Generator) -> None:
    # Costs as in a photograph: each pixel has a valley somewhere near a smooth surface.
    y, x = np.mgrid[:20, :30]
    for kind, labels in itertools.product(("absolute", "quadratic"), (5, 16, 23)):
        surface = (labels - 1) * (0.5 + 0.4 * np.sin(y / 7) * np.cos(x / 9))
        valley = surface + rng.normal(0, 1.5, surface.shape)
        unary = np.minimum(3 * (valley[..., None] - np.arange(labels)) ** 2, 400).astype(np.uint16)
        energy = mrf.Energy(unary, random_energy(rng, 1, 1, labels, kind).smoothness)
        swept = mrf.expansion(energy).energy
        assert mrf.split(energy, "default").energy <= 1.03 * swept
        assert mrf.split(energy, "high").energy <= 1.01 * swept


def test_split_hands_potts_to_expansion(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 8, 9, 6, "potts", weighted=True)
    assert mrf.split(energy).energy == mrf.expansion(energy).energy


def test_results_do_not_depend_on_threads(rng: np.random.Generator) -> None:
    energies = [random_energy(rng, 20, 25, 16, "absolute") for _ in range(8)]
    alone = [mrf.split(energy) for energy in energies]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(mrf.split, energies))
    for first, second in zip(alone, together, strict=True):
        assert first.history == second.history
        assert np.array_equal(first.labels, second.labels)


@pytest.mark.parametrize("kind", ["absolute", "truncated-absolute", "potts", "published"])
def test_expansion_ends_where_no_label_lowers_it(rng: np.random.Generator, kind: str) -> None:
    energy = random_energy(rng, 10, 12, 8, kind, weighted=True)
    labels = mrf.expansion(energy).labels.astype(np.int32)
    for label in range(8):
        assert Mover(energy, labels).move(expansion_offer(8, label)) == 0


def test_expansion_starts_and_stops_as_told(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 6, 7, 5, "absolute")
    start = rng.integers(0, 5, (6, 7))
    solution = mrf.expansion(energy, start=start, max_sweeps=1)
    assert (solution.history[0], len(solution.history)) == (energy.evaluate(start), 2)


def test_jumps_go_both_ways_and_snaps_reach_every_label_within_half_a_period() -> None:
    jumps = [(4, 9, 5, 9), (4, 1, 5, 1), (4, 7, 5, 5)]
    snaps = [(-5, n, start, n) for n in range(10) for start in range(10) if abs(n - start) <= 2]
    for step, target, start, reached in jumps + snaps:
        unary = np.full((4, 5, 10), 9, np.uint16)
        unary[..., target] = 0
        energy = mrf.Energy(unary, mrf.truncated_absolute(10, cap=3))
        assert (mrf.repair(energy, np.full((4, 5), start), [(step,)]).labels == reached).all()


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
    for cost, kind in ((65535, np.int32), (65535 // 4, np.uint16)):
        unary = np.full((2, 2, 3), cost, np.uint16)
        blocks = coarser(mrf.Energy(unary, mrf.truncated_absolute(3, cap=2)))
        assert (blocks.unary.dtype, blocks.unary.tolist()) == (kind, [[[4 * cost] * 3]])


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (6, 7), (13, 8)])
def test_every_block_size_lowers_the_energy(
    rng: np.random.Generator, shape: tuple[int, int]
) -> None:
    energy = random_energy(rng, *shape, 20, "absolute", weighted=True)
    asked = []

    def begin(blocks: mrf.Energy) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
        asked.append(blocks.shape)
        return np.zeros(blocks.shape, np.int64)

    solution = coarse_to_fine(energy, begin, [(8, 4), (), (0, 2, 1)])
    assert asked == [((shape[0] + 3) // 4, (shape[1] + 3) // 4)]
    assert solution.history[0] == energy.evaluate(np.zeros(shape, int))
    assert solution.history[1] == solution.history[2]
    assert list(solution.history) == sorted(solution.history, reverse=True)
    assert solution.energy == energy.evaluate(solution.labels)


def test_costs_too_large_for_blocks_are_solved_on_pixels(rng: np.random.Generator) -> None:
    energy = random_energy(rng, 4, 5, 20, "absolute")
    large = replace(energy, unary=energy.unary.astype(np.int32))
    large.unary[0, 0, 3] = 2**26
    solution = mrf.split(large)
    assert solution.labels[0, 0] != 3
    assert solution.energy == large.evaluate(solution.labels)
