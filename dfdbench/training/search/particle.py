"""Particles: networks as positions in a box, and how a swarm moves them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from dfdbench.blur.recipe import LEVELS, KernelSize
from dfdbench.errors import InputError
from dfdbench.methods.networks import choices
from dfdbench.methods.networks.architectures import ACTIVATIONS
from dfdbench.system.strict import Record, problems_of

#: The search as in the thesis's text, or as in its author's program.
VARIANTS = ("thesis", "author")
#: Layers that share a width, and those of them that share a filter size, output to input. Layer 1
#: is fixed, and so are the sizes of filters that halve and double the resolution.
ROWS: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...] = (
    ((5, 12), (5, 12)),
    ((8,), (8,)),
    ((15,), ()),
    ((17, 24), (17, 24)),
    ((20,), (20,)),
    ((27,), ()),
    ((29, 34), (29,)),
    ((32,), (32,)),
    ((37, 42), (37,)),
    ((40,), (40,)),
    ((45, 52), (45, 52)),
    ((48,), (48,)),
)
#: Patches per step by the rows and columns of a patch, each in eight orientations.
PATCHES = {
    12: 100, 16: 90, 20: 65, 24: 56, 28: 40, 32: 28, 36: 20, 40: 18, 44: 16, 48: 14, 52: 10,
    56: 8, 60: 6, 64: 5,
}  # fmt: skip
_KINDS = tuple(ACTIVATIONS)
_OUTWARD = tuple(reversed(choices.SITES))


def _names() -> tuple[str, ...]:
    names = []
    for layers, sized in ROWS:
        names.append("width_" + "_".join(map(str, layers)))
        names += [f"{side}_" + "_".join(map(str, sized)) for side in ("rows", "columns") if sized]
    names += [f"{kind}_{site}" for kind in ("normalized", "activation") for site in _OUTWARD]
    return (*names, "crop")


#: The name of each component, output to input; numbers are the thesis's layers.
COMPONENTS = _names()


_Side = Annotated[int, Field(multiple_of=4)]


class Bounds(Record):
    """What a particle may describe; the defaults are those of Tables C.1 and C.3.

    Parameters
    ----------
    width : tuple of int
        Filters of a layer.
    kernel : tuple of int
        Rows and columns of a filter, odd.
    crop : tuple of int
        Rows and columns of a patch, multiples of four.
    """

    width: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(le=512)]] = (8, 512)
    kernel: tuple[KernelSize, Annotated[KernelSize, Field(le=9)]] = (1, 9)
    crop: tuple[Annotated[_Side, Field(ge=12)], Annotated[_Side, Field(le=64)]] = (12, 64)

    @model_validator(mode="after")
    def _fit(self) -> Bounds:
        for name, (low, high) in self:
            if low > high:
                raise ValueError(f"{name}: the lower bound first, got {low}:{high}")
        return self


def bounds_of(given: Mapping[str, str]) -> Bounds:
    """Parse bounds from texts such as ``8:256``, by name.

    Raises
    ------
    InputError
        If they are invalid.

    Examples
    --------
    >>> bounds_of({"crop": "12:24"}).crop
    (12, 24)
    """
    try:
        return Bounds.model_validate({name: str(text).split(":") for name, text in given.items()})
    except ValidationError as error:
        what = "not the bounds of a search"
        fix = "as width=8:512, kernel=1:9, crop=12:64"
        raise InputError.of(problems_of(error, what, file="--bounds", fix=fix)) from error


class Particle(Record):
    """The meaning of a position: each field is the training configuration's choice of that name."""

    filters: list[int]
    kernels: list[tuple[int, int]]
    activations: list[str]
    normalized: list[bool]
    crop: int


def box_of(bounds: Bounds, author: bool = False) -> Box:
    """Return the box that particles move in: Tables C.1 to C.3.

    Parameters
    ----------
    bounds : Bounds
        What a particle may describe.
    author : bool
        Follow the author's program: a filter's rows and columns change by at most half as much; the
        patch size wraps around at its limits, starts at its largest velocity and moves by the
        velocity of the previous iteration; positions are whole numbers.

    Examples
    --------
    >>> box_of(Bounds()).high[-1].item()
    13.0
    """
    halves, kernel_speed = [size // 2 for size in bounds.kernel], 1 if author else 2
    limits = {
        # lowest, highest, fastest, fastest at first
        "width": (*bounds.width, 16, 8),
        "rows": (*halves, kernel_speed, 1),
        "columns": (*halves, kernel_speed, 1),
        "normalized": (0, 1, 1, 1),
        "activation": (0, len(_KINDS) - 1, 1, 1),
        "crop": (*((side - 12) // 4 for side in bounds.crop), 1, 1),
    }
    kinds = [name.partition("_")[0] for name in COMPONENTS]
    columns = np.array([limits[kind] for kind in kinds], np.float64).T
    wraps = np.array([kind == "activation" or (author and kind == "crop") for kind in kinds])
    late = (kinds.index("crop"),) if author else ()
    return Box(columns[0], columns[1], columns[2], columns[3], wraps, author, late)


def whole_numbers(positions: Numbers) -> NDArray[np.int64]:
    """Round components to the nearest whole numbers, shape (..., components)."""
    found = np.floor(positions + 0.5).astype(np.int64)
    kinds = np.array([name.startswith("activation") for name in COMPONENTS])
    return np.where(kinds, found % len(_KINDS), found)


def particle_at(position: Numbers) -> Particle:
    """Return the network that a position describes.

    Examples
    --------
    >>> particle_at(published_position()).filters[-2:]
    [128, 256]
    """
    values = dict(zip(COMPONENTS, whole_numbers(position).tolist(), strict=True))
    widths, sizes = {1: LEVELS}, {1: (3, 3)}
    for layers, sized in ROWS:
        widths |= dict.fromkeys(layers, values["width_" + "_".join(map(str, layers))])
        if sized:
            label = "_".join(map(str, sized))
            size = (2 * values[f"rows_{label}"] + 1, 2 * values[f"columns_{label}"] + 1)
            sizes |= dict.fromkeys(sized, size)
    return Particle(
        filters=[widths[layer] for layer in choices.LAYERS],
        kernels=[sizes[layer] for layer in choices.SIZED],
        activations=[_KINDS[values[f"activation_{site}"]] for site in choices.SITES],
        normalized=[bool(values[f"normalized_{site}"]) for site in choices.SITES],
        crop=4 * values["crop"] + 12,
    )


def published_position() -> Numbers:
    """Return the position of DfD-Net itself, trained on patches of 32 pixels."""
    widths = dict(zip(choices.LAYERS, choices.FILTERS["original"], strict=True))
    position: list[float] = []
    for layers, sized in ROWS:
        position += [widths[layers[0]], *([1, 1] if sized else [])]
    position += [1] * len(_OUTWARD)
    position += [_KINDS.index("prelu")] * len(_OUTWARD)
    return np.array([*position, (32 - 12) / 4], np.float64)


Numbers = NDArray[np.float64]
#: How strongly a particle is drawn to its own best position, and to the swarm's (C.1).
COGNITIVE, SOCIAL = 2.4, 2.1


_PHI = COGNITIVE + SOCIAL
#: Clerc and Kennedy's factor, Eq. C.1.
KAPPA = 2 / abs(2 - _PHI - math.sqrt(_PHI * _PHI - 4 * _PHI))


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
        Velocities start uniformly between this and its negative.
    wraps : ndarray of bool
        Components that wrap around: one step beyond `high` is `low` again. Others stop at their
        limits.
    whole : bool
        Positions start at whole numbers, with equal probability, and are rounded after every move.
    late : tuple of int
        Components that start at `fastest_first` and then move by the velocity of the previous
        iteration.
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
        """The end of positions: `high`, or where a wrapping component is at `low` again."""
        return np.where(self.wraps, self.high + 1, self.high)

    def limited(self, positions: Numbers) -> Numbers:
        """Return positions limited to the box, shape (..., components)."""
        found = np.floor(positions + 0.5) if self.whole else positions
        round_ = self.low + np.mod(found - self.low, self.high - self.low + 1)
        # A remainder may be rounded up to the divisor itself.
        round_ = np.where(round_ >= self.above, self.low, round_)
        return np.where(self.wraps, round_, np.clip(found, self.low, self.high))


@dataclass(frozen=True)
class Swarm:
    """The complete state that determines the next iteration.

    Parameters
    ----------
    iteration : int
        0 at the start.
    positions, velocities : ndarray of float64, shape (particles, components)
        x and v.
    own : ndarray of float64, shape (particles, components)
        p, the position that each particle remembers as its own best.
    own_values : ndarray of float64, shape (particles,)
        A particle's next value must be below this to replace p; infinite at first.
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
    """Return the random numbers of one particle in one iteration; they depend on nothing else."""
    return np.random.default_rng((seed, iteration, particle))


def begun(box: Box, particles: int, seed: int, known: Numbers | None = None) -> Swarm:
    """Return a swarm at random places of a box, before any evaluation.

    Parameters
    ----------
    box : Box
        The box.
    particles : int
        How many particles.
    seed : int
        Determines everything that is random.
    known : ndarray, optional
        The first particle's start, in place of a random one.
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
    """Return a swarm updated with the values of its positions (Algorithm C.1).

    A best position is replaced only by a strictly better one; NaN is never better.

    Parameters
    ----------
    swarm : Swarm
        The swarm after its move.
    values : ndarray of float64, shape (particles,)
        The values to minimise, at `swarm.positions`.
    against_previous : bool
        Replace a particle's own best if its value is below that of the previous iteration, even if
        the own best is lower; the thesis's prose and its author's program do this.
    """
    found = np.where(np.isnan(values), np.inf, values)
    better = found < swarm.own_values
    own = np.where(better[:, None], swarm.positions, swarm.own)
    own_values = found if against_previous else np.where(better, found, swarm.own_values)
    swarm = replace(swarm, own=own, own_values=own_values)
    first = int(np.argmin(found))
    value, place = float(found[first]), (swarm.iteration, first)
    if not value < swarm.best_value:
        return swarm
    return replace(swarm, best=swarm.positions[first], best_value=value, best_at=place)


def moved(swarm: Swarm, box: Box, seed: int) -> Swarm:
    """Return the swarm after one more iteration (Eq. C.2 and C.3), limited to the box."""
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
    """Yield the swarm after its start and after each iteration, with its values.

    If a second call's judge gives the same values, it yields the same swarms.

    Parameters
    ----------
    judge : callable
        Returns a value for each of a swarm's positions, shape (particles,).
    box, particles, seed, known
        As in `begun`.
    iterations : int
        Moves after the start.
    against_previous
        As in `judged`.

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
