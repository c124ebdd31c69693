from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")

from dfdbench.training.search.particle import COMPONENTS, Bounds, box_of
from dfdbench.training.search.swarm import Numbers, begun, search
from dfdbench.training.search.variants import VARIANTS


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
