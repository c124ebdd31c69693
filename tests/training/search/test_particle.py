import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dfdbench.errors import InputError
from dfdbench.methods.networks.choices import FILTERS, LAYERS, SIZED
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.search import particle as pso
from tests.training.search.made_searches import position_of


def test_a_particle_has_51_components_as_the_author_counts_them() -> None:
    assert len(pso.COMPONENTS) == len(set(pso.COMPONENTS)) == 12 + 2 * 10 + 9 + 9 + 1 == 51
    # The author's map from layers to rows, output to input; row 1 is fixed.
    rows = [1, 2, 3, 2, 4, 5, 6, 5, 7, 8, 9, 8, 10, 11, 10, 12, 13, 12]
    for layer, row in list(zip(reversed(LAYERS), rows, strict=True))[1:]:
        assert layer in pso.ROWS[row - 2][0]
    assert {layer for _, sized in pso.ROWS for layer in sized} == set(SIZED) - {1}
    # The author begins with DfD-Net itself.
    assert np.array_equal(pso.published_position(), position_of(FILTERS["original"]))


def test_mapping_functions_are_those_of_appendix_c() -> None:
    position = position_of(FILTERS["original"])
    for name, value in {
        **{"width_5_12": 127.5, "rows_5_12": 3.4999, "columns_5_12": 3.5, "crop": 12.5},
        # The first goes round to ReLU.
        **{"activation_entry": 5.6, "activation_classify": 4.6, "normalized_entry": 0.49},
    }.items():
        position[pso.COMPONENTS.index(name)] = value
    found = pso.particle_at(position)
    sizes = dict(zip(SIZED, found.kernels, strict=True))
    assert sizes[5] == sizes[12] == (7, 9)
    assert sizes[1] == sizes[48] == (3, 3)
    widths = dict(zip(LAYERS, found.filters, strict=True))
    assert widths[5] == widths[12] == 128
    assert (found.activations[0], found.activations[-1]) == ("relu", "srelu")
    assert (found.normalized, found.crop) == ([False] + [True] * 8, 64)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_all_of_the_box_is_networks_and_back(seed: int, author: bool) -> None:
    (position,) = pso.begun(pso.box_of(pso.Bounds(), author), 1, seed).positions
    particle = pso.particle_at(position)
    assert set(particle.filters[:-1]) <= set(range(8, 513))
    assert {side for size in particle.kernels for side in size} <= {1, 3, 5, 7, 9}
    assert particle.crop in pso.PATCHES
    TrainingConfiguration.model_validate(particle.model_dump()).architecture("dfd-net")
    again = position_of(**particle.model_dump())
    assert np.array_equal(again, pso.whole_numbers(position))


def test_bounds_make_the_box_smaller_and_what_are_none_is_told() -> None:
    bounds = pso.bounds_of({"width": "16:64", "kernel": "3:5", "crop": "12:24"})
    box = pso.box_of(bounds)
    sides = {name: (box.low[i], box.high[i]) for i, name in enumerate(pso.COMPONENTS)}
    assert sides["width_8"] == (16, 64)
    assert sides["rows_8"] == sides["columns_48"] == (1, 2)
    assert (sides["crop"], sides["activation_entry"]) == ((0, 3), (0, 5))
    for name, ends, said in (
        ("kernel", "2:9", "expected odd"),
        ("crop", "12:30", "multiple of 4"),
        ("width", "9:8", "lower bound first"),
        ("width", "8", "field is missing"),
        ("kernel", "1:11", "9 or less"),
    ):
        with pytest.raises(InputError, match=said) as caught:
            pso.bounds_of({name: ends})
        assert "--bounds" in str(caught.value)


def test_the_author_s_box_is_the_text_s_but_for_what_is_said() -> None:
    text, author = (pso.box_of(pso.Bounds(), author) for author in (False, True))
    assert np.array_equal(text.low, author.low)
    assert np.array_equal(text.high, author.high)
    sizes = np.array([name.startswith(("rows", "columns")) for name in pso.COMPONENTS])
    assert np.array_equal(text.fastest != author.fastest, sizes)
    assert (set(text.fastest[sizes]), set(author.fastest[sizes])) == ({2.0}, {1.0})
    assert [pso.COMPONENTS[i] for i in np.flatnonzero(text.wraps != author.wraps)] == ["crop"]
    assert (text.whole, author.whole) == (False, True)
    assert [pso.COMPONENTS[i] for i in author.late] == ["crop"]
    assert text.late == ()


class AuthorsProgram:
    """The author's swarm by its description, a number at a time; positions count from 0."""

    def __init__(self, positions: pso.Numbers, velocities: pso.Numbers, seed: int) -> None:
        self.x, self.v, self.seed = positions.tolist(), velocities.tolist(), seed
        self.p: list[list[float]] = []
        self.g: list[float] = []
        self.before: list[float] = []
        self.g_value, self.iteration = float("inf"), 0

    def take(self, values: list[float]) -> None:
        if not self.p:
            self.p = [list(x) for x in self.x]
        for i, (value, before) in enumerate(zip(values, self.before, strict=False)):
            if value < before:
                self.p[i] = list(self.x[i])
        if min(values) < self.g_value:
            self.g_value = min(values)
            self.g = list(self.x[values.index(self.g_value)])
        self.before = values

    def move(self) -> None:
        self.iteration += 1
        for i in range(len(self.x)):
            r, s = np.random.default_rng((self.seed, self.iteration, i)).random((2, 51))
            for j, name in enumerate(pso.COMPONENTS):
                fastest = 16 if name.startswith("width") else 1
                x, old = self.x[i][j], self.v[i][j]
                pull = 2.4 * r[j] * (self.p[i][j] - x) + 2.1 * s[j] * (self.g[j] - x)
                new = min(max(0.5 * (old + pull), -fastest), fastest)
                self.v[i][j] = new
                there = math.floor(x + (old if name == "crop" else new) + 0.5)
                if name == "crop":
                    there %= 14
                elif name.startswith("activation"):
                    there %= 6
                else:
                    low, high = {"w": (8, 512), "n": (0, 1)}.get(name[0], (0, 4))
                    there = min(max(there, low), high)
                self.x[i][j] = float(there)


@pytest.mark.parametrize("seed", range(4))
def test_the_author_s_variant_moves_as_the_author_s_program(seed: int) -> None:
    box, random = pso.box_of(pso.Bounds(), author=True), np.random.default_rng(seed)
    values = random.uniform(0.4, 0.9, (15, 6)).round(2)
    own: list[bool] = []
    start = pso.begun(box, 6, seed)
    program = AuthorsProgram(start.positions, start.velocities, seed)
    swarms = pso.search(lambda s: values[s.iteration], box, 6, 14, seed, against_previous=True)
    for swarm in swarms:
        if swarm.iteration:
            program.move()
        program.take(values[swarm.iteration].tolist())
        assert np.array_equal(swarm.positions, program.x)
        assert np.array_equal(swarm.own, program.p)
        assert np.array_equal(swarm.best, program.g)
        assert np.allclose(swarm.velocities, program.v, rtol=0, atol=1e-12)
        own.append(bool((swarm.own_values > values[: swarm.iteration + 1].min(0)).any()))
    # The rules do differ here: some particle gave up a better position of its own.
    assert any(own)


def cube(side: float, components: int, share: float = 1.0) -> pso.Box:
    sides = np.full(components, side)
    return pso.Box(-sides, sides, share * sides, share * sides, np.zeros(components, bool))


def test_an_iteration_is_eq_c2_and_c3_by_hand() -> None:
    box = cube(10.0, 2, 0.1)
    swarm = pso.judged(pso.begun(box, 2, 7), np.array([2.0, 1.0]))
    swarm = pso.judged(pso.moved(swarm, box, 7), np.array([3.0, 3.0]))
    after = pso.moved(swarm, box, 7)
    for i in range(2):
        r, s = np.random.default_rng((7, 2, i)).random((2, 2))
        x, v = swarm.positions[i], swarm.velocities[i]
        expected = 0.5 * (v + 2.4 * r * (swarm.own[i] - x) + 2.1 * s * (swarm.best - x))
        expected = np.clip(expected, -1, 1)
        assert np.allclose(after.velocities[i], expected, rtol=0, atol=1e-15)
        assert np.allclose(after.positions[i], np.clip(x + expected, -10, 10), rtol=0, atol=1e-15)


def mixed(whole: bool) -> pso.Box:
    """A width, a filter's side, an activation, which goes round, and a bit."""
    low, high, fastest, first = np.array(
        [[8, 512, 16, 8], [0, 4, 2, 1], [0, 5, 1, 1], [0, 1, 1, 1]], float
    ).T
    return pso.Box(low, high, fastest, first, np.array([False, False, True, False]), whole)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.integers(1, 5))
def test_it_stays_in_its_box_and_never_gets_worse(seed: int, whole: bool, particles: int) -> None:
    box, random = mixed(whole), np.random.default_rng(seed)

    def judge(swarm: pso.Swarm) -> pso.Numbers:
        drawn = random.normal(size=particles).round(1)
        drawn[random.random(particles) < 0.2] = np.inf
        drawn[random.random(particles) < 0.1] = np.nan
        return drawn

    before = None
    for swarm in pso.search(judge, box, particles, 12, seed):
        for position in (*swarm.positions, *swarm.own, swarm.best):
            assert np.array_equal(box.limited(position), position)
            assert not whole or np.array_equal(position, np.rint(position))
        limit = box.fastest_first if before is None else box.fastest
        assert np.all(np.abs(swarm.velocities) <= limit)
        assert swarm.best_value == swarm.own_values.min()
        if before is not None:
            assert swarm.best_value <= before.best_value
            assert np.all(swarm.own_values <= before.own_values)
        before = swarm


def test_only_what_is_strictly_better_takes_a_place() -> None:
    box = cube(1.0, 3)
    first = pso.judged(pso.begun(box, 3, 0), np.array([2.0, 1.0, 1.0]))
    assert first.best_at == (0, 1)
    same = pso.judged(pso.moved(first, box, 0), np.array([2.0, 1.0, np.nan]))
    assert np.array_equal(same.own, first.own)
    assert same.best_at == (0, 1)
    better = pso.judged(pso.moved(same, box, 0), np.array([3.0, np.inf, 0.5]))
    assert better.best_at == (2, 2)
    assert np.array_equal(better.best, better.positions[2])
    assert better.own_values.tolist() == [2.0, 1.0, 0.5]


def test_what_goes_round_comes_in_again() -> None:
    box = mixed(whole=False)
    given = np.array([[0.0, 5.0, -0.25, -1.0], [600.0, 2.2, 6.0, 0.3], [9.0, 0.0, 5.9, 2.0]])
    expected = [[8.0, 4.0, 5.75, 0.0], [512.0, 2.2, 0.0, 0.3], [9.0, 0.0, 5.9, 1.0]]
    assert box.limited(given) == pytest.approx(np.array(expected))
    # A remainder of next to nothing below is rounded to the divisor.
    assert box.limited(np.array([8.0, 0.0, -1e-17, 0.0]))[2] == 0.0
    assert mixed(whole=True).limited(np.array([8.5, 1.4, 5.6, 0.5])).tolist() == [9, 1, 0, 1]
