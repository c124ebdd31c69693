from __future__ import annotations

import time

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.errors import InputError
from dfdbench.training.reduction.self_organising_map import (
    TUNINGS,
    Matrix,
    Tuning,
    noise_gram,
    winners,
)


def on_vectors(vectors: Matrix, seed: int, tuning: Tuning) -> NDArray[np.intp]:
    """The map as its definition has it: neurons are vectors, distances are taken one by one."""
    count = len(vectors)
    centred = vectors - vectors.mean(0)
    values, components = np.linalg.eigh(centred @ centred.T)
    first = components[:, -1] * np.sign(components[np.abs(components[:, -1]).argmax(), -1])
    direction = centred.T @ first / np.sqrt(values[-1])
    deviation = np.sqrt(values[-1] / count)
    neurons = np.linspace(-2.5, 2.5, count)[:, None] * deviation * direction

    def closest() -> NDArray[np.intp]:
        won = []
        for vector in centred:
            won.append(int(((neurons - vector) ** 2).sum(1).argmin()))
        return np.array(won)

    random = np.random.default_rng(seed)
    for epoch in range(200):
        won = closest()
        counted = random.random(count) >= 0.1
        late = 1.0 if tuning == "neighbours" else 0.0
        radius = 1 + (2 - 1) * (1 - epoch / 100) if epoch < 100 else late
        moved = neurons.copy()
        for neuron in range(count):
            shares = (np.abs(won - neuron) <= radius).astype(float) + (won == neuron)
            shares *= counted
            if shares.any():
                moved[neuron] = shares @ centred / shares.sum()
        neurons = moved
    return closest()


def different(won: NDArray[np.intp]) -> int:
    return len(np.unique(won))


@pytest.mark.parametrize("tuning", TUNINGS)
def test_on_products_it_is_the_map_on_vectors(tuning: Tuning) -> None:
    random = np.random.default_rng(5)
    vectors = random.standard_normal((6, 40))[random.integers(0, 6, 24)]
    vectors = 7 + vectors + 0.3 * random.standard_normal((24, 40))
    expected = on_vectors(vectors, 3, tuning)
    assert winners(vectors @ vectors.T, 3, tuning).tolist() == expected.tolist()
    assert 2 < different(expected) < 24


def test_twenty_groups_of_equal_outputs_among_128_are_found_and_no_more() -> None:
    for seed in range(4):
        random = np.random.default_rng(seed)
        group = random.permutation(np.arange(128) % 20)
        vectors = random.standard_normal((20, 2000))[group]
        won = winners(vectors @ vectors.T, seed)
        assert different(won) == 20
        assert all(different(won[group == number]) == 1 for number in range(20))


@pytest.mark.slow
def test_a_count_has_no_zero_point() -> None:
    # The reference: 46 to 56 of 128, 83 to 107 of 256, where nothing is redundant; and groups
    # whose members differ by a hundredth are split, so that a count is no number of groups.
    random = np.random.default_rng(0)
    for filters, lowest, highest in ((128, 42, 58), (256, 80, 107)):
        found = []
        for seed in range(6):
            vectors = random.standard_normal((filters, 2000))
            found.append(different(winners(vectors @ vectors.T, seed)))
        assert lowest <= np.mean(found) <= highest
    groups = random.standard_normal((20, 2000))[np.arange(128) % 20]
    alike = groups + 0.01 * random.standard_normal(groups.shape)
    assert different(winners(alike @ alike.T)) > 40


@pytest.mark.slow
def test_512_filters_take_less_than_a_minute() -> None:
    gram = noise_gram(512, 2000, np.random.default_rng(1))
    begin = time.process_time()
    found = different(winners(gram))
    assert time.process_time() - begin < 60
    assert 150 <= found <= 205  # 179 in the reference


def test_noise_is_drawn_as_vectors_would_be() -> None:
    random = np.random.default_rng(2)
    grams = np.array([noise_gram(4, 50, random) for _ in range(3000)])
    assert grams.mean(0) == pytest.approx(50 * np.eye(4), abs=0.8)
    # Of a Wishart distribution: n off the diagonal, 2 n on it.
    assert grams.var(0) == pytest.approx(50 * (np.eye(4) + 1), rel=0.15)


def test_a_place_and_equal_inputs_do_not_matter() -> None:
    vectors = np.random.default_rng(3).standard_normal((16, 200))
    won = winners(vectors @ vectors.T)
    moved = vectors + 1000
    assert winners(moved @ moved.T).tolist() == won.tolist()
    assert winners(np.ones((5, 5))).tolist() == [0] * 5
    assert winners(np.zeros((1, 1))).tolist() == [0]


def test_an_unknown_tuning_is_refused() -> None:
    with pytest.raises(InputError, match="own or neighbours"):
        winners(np.eye(3), 0, "others")  # type: ignore[arg-type]
