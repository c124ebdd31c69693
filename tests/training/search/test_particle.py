from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from hypothesis import given, settings
from hypothesis import strategies as st

from dfdbench.errors import InputError
from dfdbench.methods.networks.choices import FILTERS, LAYERS, SIZED
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.search.particle import (
    COMPONENTS,
    PATCHES,
    ROWS,
    VARIANTS,
    Bounds,
    bounds_of,
    box_of,
    particle_at,
    position_of,
    whole_numbers,
)
from dfdbench.training.search.swarm import Numbers, begun, search


def test_a_particle_has_51_components_as_the_author_counts_them() -> None:
    assert len(COMPONENTS) == len(set(COMPONENTS)) == 12 + 2 * 10 + 9 + 9 + 1 == 51
    # The author's map from layers to rows, output to input; row 1 is fixed.
    rows = [1, 2, 3, 2, 4, 5, 6, 5, 7, 8, 9, 8, 10, 11, 10, 12, 13, 12]
    for layer, row in list(zip(reversed(LAYERS), rows, strict=True))[1:]:
        assert layer in ROWS[row - 2][0]
    free = {layer for _, sized in ROWS for layer in sized}
    assert free == set(SIZED) - {1}


@pytest.mark.parametrize("name", FILTERS)
def test_every_named_network_is_a_particle_s(name: str) -> None:
    first = "sigmoid" if name == "pso" else "prelu"
    particle = particle_at(position_of(FILTERS[name], first_activation=first))
    found = TrainingConfiguration.model_validate(particle.model_dump()).architecture("dfd-net")
    named = TrainingConfiguration(
        filters=name, first_activation="sigmoid" if name == "pso" else "prelu"
    )
    assert found == named.architecture("dfd-net")
    assert particle.crop == 32


def test_mapping_functions_are_those_of_appendix_c() -> None:
    position = position_of(FILTERS["original"])
    position[COMPONENTS.index("width_5_12")] = 127.5
    position[COMPONENTS.index("rows_5_12")] = 3.4999
    position[COMPONENTS.index("columns_5_12")] = 3.5
    position[COMPONENTS.index("activation_entry")] = 5.6  # goes round to ReLU
    position[COMPONENTS.index("activation_classify")] = 4.6
    position[COMPONENTS.index("normalized_entry")] = 0.49
    position[COMPONENTS.index("crop")] = 12.5
    found = particle_at(position)
    sizes = dict(zip(SIZED, found.kernels, strict=True))
    assert sizes[5] == sizes[12] == (7, 9)
    assert sizes[1] == sizes[48] == (3, 3)
    widths = dict(zip(LAYERS, found.filters, strict=True))
    assert widths[5] == widths[12] == 128
    assert (found.activations[0], found.activations[-1]) == ("relu", "srelu")
    assert found.normalized == [False] + [True] * 8
    assert found.crop == 64


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(VARIANTS)))
def test_all_of_the_box_is_networks_and_back(seed: int, variant: str) -> None:
    box = box_of(Bounds(), VARIANTS[variant])
    (position,) = begun(box, 1, seed).positions
    particle = particle_at(position)
    assert set(particle.filters[:-1]) <= set(range(8, 513))
    assert {side for size in particle.kernels for side in size} <= {1, 3, 5, 7, 9}
    assert particle.crop in PATCHES
    TrainingConfiguration.model_validate(particle.model_dump()).architecture("dfd-net")
    again = position_of(**particle.model_dump())
    assert np.array_equal(again, whole_numbers(position))


def test_bounds_make_the_box_smaller() -> None:
    box = box_of(
        bounds_of({"width": "16:64", "kernel": "3:5", "crop": "12:24"}), VARIANTS["thesis"]
    )
    ends = {name: (box.low[i], box.high[i]) for i, name in enumerate(COMPONENTS)}
    assert ends["width_8"] == (16, 64)
    assert ends["rows_8"] == ends["columns_48"] == (1, 2)
    assert ends["crop"] == (0, 3)
    assert ends["activation_entry"] == (0, 5)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"kernel": "2:9"}, "odd numbers"),
        ({"crop": "12:30"}, "multiples of 4"),
        ({"width": "9:8"}, "lower bound first"),
        ({"width": "8"}, "field is missing"),
        ({"kernel": "1:11"}, "less than or equal to 9"),
        ({"height": "1:2"}, "unknown field"),
        ({"width": "a:b"}, "integer"),
    ],
)
def test_what_are_no_bounds_is_told(given: dict[str, str], told: str) -> None:
    with pytest.raises(InputError, match=told) as caught:
        bounds_of(given)
    assert "--bounds" in str(caught.value)


def test_the_author_s_box_is_the_text_s_but_for_what_is_said() -> None:
    text, author = (box_of(Bounds(), VARIANTS[name]) for name in ("thesis", "author"))
    assert np.array_equal(text.low, author.low)
    assert np.array_equal(text.high, author.high)
    sizes = np.array([name.startswith(("rows", "columns")) for name in COMPONENTS])
    assert np.array_equal(text.fastest != author.fastest, sizes)
    assert (set(text.fastest[sizes]), set(author.fastest[sizes])) == ({2.0}, {1.0})
    assert [COMPONENTS[i] for i in np.flatnonzero(text.wraps != author.wraps)] == ["crop"]
    assert (text.whole, author.whole) == (False, True)
    assert [COMPONENTS[i] for i in author.late] == ["crop"]
    assert text.late == ()


class AuthorsProgram:
    """The author's swarm by its description, a number at a time; positions count from 0."""

    def __init__(self, positions: Numbers, velocities: Numbers, seed: int) -> None:
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
            for j, name in enumerate(COMPONENTS):
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
    variant = VARIANTS["author"]
    box, random = box_of(Bounds(), variant), np.random.default_rng(seed)
    values = random.uniform(0.4, 0.9, (15, 6)).round(2)
    own: list[bool] = []
    start = begun(box, 6, seed)
    program = AuthorsProgram(start.positions, start.velocities, seed)
    swarms = search(
        lambda swarm: values[swarm.iteration],
        box,
        6,
        14,
        seed,
        against_previous=variant.against_previous,
    )
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


def test_the_author_s_swarm_starts_at_whole_numbers_and_with_larger_patches() -> None:
    swarm = begun(box_of(Bounds(), VARIANTS["author"]), 400, 1)
    assert (swarm.velocities[:, COMPONENTS.index("crop")] == 1).all()
    sizes = [i for i, name in enumerate(COMPONENTS) if name.startswith(("rows", "columns"))]
    shares = np.bincount(swarm.positions[:, sizes].astype(int).ravel()) / (400 * len(sizes))
    assert shares == pytest.approx(np.full(5, 0.2), abs=0.02)
