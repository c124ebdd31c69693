"""Particle swarm with a constriction factor (App. C): a box of numbers searched for a minimum."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]

#: How strongly a particle is drawn to its own best position, and to the swarm's (C.1).
COGNITIVE, SOCIAL = 2.4, 2.1


def constriction(cognitive: float = COGNITIVE, social: float = SOCIAL) -> float:
    """Return Clerc and Kennedy's factor kappa, Eq. C.1.

    Examples
    --------
    >>> constriction()
    0.5
    """
    phi = cognitive + social
    return 2 / abs(2 - phi - math.sqrt(phi * phi - 4 * phi))


KAPPA = constriction()


@dataclass(frozen=True)
class Box:
    """Where particles may be, and how fast they may move; each an array of shape (components,).

    Parameters
    ----------
    low, high : ndarray of float64
        Limits of a position.
    fastest : ndarray of float64
        Limit of a velocity, in both directions.
    fastest_first : ndarray of float64
        Velocities begin uniformly between this and its negative.
    wraps : ndarray of bool
        Components that go round: after `high` comes `low` again, a step of one further. Others
        stop at their limits.
    whole : bool
        Positions start at whole numbers, each equally likely, and are rounded after every move.
    late : tuple of int
        Components that start at `fastest_first` and then move by the velocity of the iteration
        before.
    """

    low: Numbers
    high: Numbers
    fastest: Numbers
    fastest_first: Numbers
    wraps: NDArray[np.bool_]
    whole: bool = False
    late: tuple[int, ...] = ()

    @property
    def above(self) -> Numbers:
        """Where positions end: `high`, or where a component that goes round is at `low` again."""
        return np.where(self.wraps, self.high + 1, self.high)

    def limited(self, positions: Numbers) -> Numbers:
        """Return positions that lie in the box, shape (..., components)."""
        found = np.floor(positions + 0.5) if self.whole else positions
        round_ = self.low + np.mod(found - self.low, self.high - self.low + 1)
        # A remainder may be rounded up to the divisor itself.
        round_ = np.where(round_ >= self.above, self.low, round_)
        return np.where(self.wraps, round_, np.clip(found, self.low, self.high))


@dataclass(frozen=True)
class Swarm:
    """All that the next iteration follows from.

    Parameters
    ----------
    iteration : int
        0 at the start.
    positions, velocities : ndarray of float64, shape (particles, components)
        x and v.
    own : ndarray of float64, shape (particles, components)
        p, the position that each particle remembers as its own best.
    own_values : ndarray of float64, shape (particles,)
        What a particle's next value has to be below to replace p; infinite at first.
    best : ndarray of float64, shape (components,)
        g, the best position of all.
    best_value : float
        Its value.
    best_at : tuple of int
        The iteration and the particle that found it.
    """

    iteration: int
    positions: Numbers
    velocities: Numbers
    own: Numbers
    own_values: Numbers
    best: Numbers
    best_value: float
    best_at: tuple[int, int]


def random_of(seed: int, iteration: int, particle: int) -> np.random.Generator:
    """Return the random numbers of one particle in one iteration: they follow from nothing else."""
    return np.random.default_rng((seed, iteration, particle))


def begun(box: Box, particles: int, seed: int, known: Numbers | None = None) -> Swarm:
    """Return a swarm at random places of a box, before anything was judged.

    Parameters
    ----------
    box : Box
        Where.
    particles : int
        How many.
    seed : int
        Whatever is random follows from it.
    known : ndarray, optional
        If the first particle begins instead.
    """
    positions, velocities = [], []
    for particle in range(particles):
        random = random_of(seed, 0, particle)
        if box.whole:
            position = random.integers(
                box.low.astype(int), box.high.astype(int), endpoint=True
            ).astype(np.float64)
        else:
            position = box.limited(random.uniform(box.low, box.above))
        velocity = random.uniform(-box.fastest_first, box.fastest_first)
        velocity[list(box.late)] = box.fastest_first[list(box.late)]
        positions.append(position)
        velocities.append(velocity)
    if known is not None:
        positions[0] = box.limited(known)
    places = np.array(positions)
    unknown = np.full(particles, np.inf)
    return Swarm(0, places, np.array(velocities), places, unknown, places[0], math.inf, (0, 0))


def judged(swarm: Swarm, values: Numbers, against_previous: bool = False) -> Swarm:
    """Return a swarm that knows the values of its positions (Algorithm C.1).

    A best position is replaced only by a strictly better one; NaN is never better.

    Parameters
    ----------
    swarm : Swarm
        As it moved.
    values : ndarray of float64, shape (particles,)
        What is to be made small, at `swarm.positions`.
    against_previous : bool
        Replace a particle's own best if its value is below that of the iteration before, even if
        the own best has a lower one; the thesis's prose and its author's program do this.
    """
    found = np.where(np.isnan(values), np.inf, values)
    better = found < swarm.own_values
    swarm = replace(
        swarm,
        own=np.where(better[:, None], swarm.positions, swarm.own),
        own_values=found if against_previous else np.where(better, found, swarm.own_values),
    )
    first = int(np.argmin(found))
    if not found[first] < swarm.best_value:
        return swarm
    return replace(
        swarm,
        best=swarm.positions[first],
        best_value=float(found[first]),
        best_at=(swarm.iteration, first),
    )


def moved(swarm: Swarm, box: Box, seed: int) -> Swarm:
    """Return the swarm an iteration on, Eq. C.2 and C.3, each particle limited to the box."""
    number, count = swarm.iteration + 1, len(swarm.positions)
    drawn = np.array([random_of(seed, number, i).random((2, len(box.low))) for i in range(count)])
    to_own, to_best = swarm.own - swarm.positions, swarm.best - swarm.positions
    pulled = COGNITIVE * drawn[:, 0] * to_own + SOCIAL * drawn[:, 1] * to_best
    velocities = np.clip(KAPPA * (swarm.velocities + pulled), -box.fastest, box.fastest)
    steps, late = velocities.copy(), list(box.late)
    steps[:, late] = swarm.velocities[:, late]
    positions = box.limited(swarm.positions + steps)
    return replace(swarm, iteration=number, positions=positions, velocities=velocities)


def search(
    judge: Callable[[Swarm], Numbers],
    box: Box,
    particles: int,
    iterations: int,
    seed: int,
    known: Numbers | None = None,
    against_previous: bool = False,
) -> Iterator[Swarm]:
    """Yield the swarm after its start and after each iteration, judged.

    Called again with a judge that gives the same values, it yields the same swarms.

    Parameters
    ----------
    judge : callable
        Gives a value for each of a swarm's positions, shape (particles,).
    box, particles, seed, known
        As of `begun`.
    iterations : int
        Moves after the start.
    against_previous
        As of `judged`.

    Examples
    --------
    >>> box = Box(*np.array([[-5.0], [5.0], [1.0], [1.0]]), np.array([False]))
    >>> *_, last = search(lambda swarm: (swarm.positions**2).sum(1), box, 10, 40, seed=1)
    >>> last.iteration, last.best_value < 1e-6
    (40, True)
    """
    swarm = begun(box, particles, seed, known)
    swarm = judged(swarm, judge(swarm), against_previous)
    yield swarm
    for _ in range(iterations):
        swarm = moved(swarm, box, seed)
        swarm = judged(swarm, judge(swarm), against_previous)
        yield swarm
