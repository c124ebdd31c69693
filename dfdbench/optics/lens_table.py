"""A lens measured step by step: its blur by voltage step and distance, and pairs of steps."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from importlib import resources
from itertools import combinations, groupby
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.errors import InputError, Problem, SourceError, reason_of
from dfdbench.system.files import read_text

_TABLE = "realworld-1/lens_blur_radius_px.csv"
#: No image has a blur of so many pixels, no lens so many steps.
_MOST = 10**6
_LAYOUT = "a heading step,0.4,0.5,... and a row a voltage step"


@dataclass(frozen=True)
class LensTable:
    """A lens's quantised blur radius in pixels (thesis, Fig. 7.9).

    Parameters
    ----------
    steps : tuple of int
        Voltage steps, ascending.
    distances : tuple of float
        In metres, ascending.
    radius : ndarray of int, shape (step, distance)
        In pixels.
    """

    steps: tuple[int, ...]
    distances: tuple[float, ...]
    radius: NDArray[np.int64]

    def radius_at(self, step: int, distance: ArrayLike) -> NDArray[np.float64]:
        """Return a step's blur radius in pixels, interpolated between the measured distances.

        Parameters
        ----------
        step : int
            A voltage step of the table.
        distance : array_like of float
            In metres; beyond the table's ends its end values hold.

        Raises
        ------
        InputError
            Where the table has no such step.
        """
        if step not in self.steps:
            raise InputError(
                "no such voltage step",
                where="lens table",
                expected=_range_text(self.steps),
                got=str(step),
            )
        row = self.radius[self.steps.index(step)].astype(np.float64)
        return np.asarray(np.interp(np.asarray(distance, np.float64), self.distances, row))


@dataclass(frozen=True)
class StepPair:
    """Two voltage steps, and how their blur radii differ over a range of distances.

    Parameters
    ----------
    first, second : int
        Voltage steps; `first` is the higher.
    distances : tuple of float
        The measured distances in the range, in metres.
    differences : tuple of int
        Absolute difference of the two radii at each, in pixels, as a row of Table 7.5.
    """

    first: int
    second: int
    distances: tuple[float, ...]
    differences: tuple[int, ...]

    @property
    def name(self) -> str:
        """As the thesis writes it: 141-129."""
        return f"{self.first}-{self.second}"

    @property
    def monotonic(self) -> bool:
        """True where the difference never turns: what the thesis requires of a pair."""
        ordered = sorted(self.differences)
        return list(self.differences) in (ordered, ordered[::-1])

    @property
    def repeats(self) -> int:
        """How many distances share their difference with an earlier one: best 0."""
        return len(self.differences) - len(set(self.differences))

    @property
    def span(self) -> int:
        """Largest less smallest difference, in pixels."""
        return max(self.differences) - min(self.differences)

    @property
    def longest_run(self) -> int:
        """Over how many neighbouring distances the difference stays the same, at most."""
        return max(len(list(run)) for _, run in groupby(self.differences))


def read_lens_table(path: Path | None = None) -> LensTable:
    """Read a lens table: a heading ``step,DISTANCE,...`` in metres, then a row a voltage step.

    Parameters
    ----------
    path : Path, optional
        A CSV file; by default the thesis's microfluidic lens, shipped with manifest realworld-1.

    Raises
    ------
    SourceError
        With every problem of the file.

    Examples
    --------
    >>> table = read_lens_table()
    >>> table.steps[0], table.steps[-1], table.radius.shape
    (127, 143, (17, 37))
    """
    shipped = resources.files("dfdbench.manifests").joinpath(_TABLE)
    try:
        text = read_text(path) if path else shipped.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        expected = f"a CSV file: {_LAYOUT}"
        raise SourceError(
            "cannot read the lens table", where=str(path), expected=expected, got=reason_of(error)
        ) from error
    return parse_lens_table(text, str(path or _TABLE))


def parse_lens_table(text: str, where: str) -> LensTable:
    """Check a lens table's text and return it; `where` is the name that problems give.

    Raises
    ------
    SourceError
        With every problem of the text.
    """
    rows = [row for row in csv.reader(text.splitlines()) if row]
    if len(rows) < 2 or rows[0][0].strip() != "step" or len(rows[0]) < 3:
        raise SourceError(
            "not a lens table",
            where=where,
            expected=_LAYOUT,
            got=",".join(rows[0][:4]) if rows else "an empty file",
        )
    problems: list[Problem] = []
    distances = _numbers(rows[0][1:], f"{where}: heading", problems)
    steps, radii = [], []
    for line, row in enumerate(rows[1:], start=2):
        place = f"{where}: line {line}"
        if len(row) != len(rows[0]):
            problems.append(
                Problem(
                    "a row of another length",
                    where=place,
                    expected=str(len(rows[0])),
                    got=str(len(row)),
                )
            )
            continue
        numbers = _whole_numbers(row, place, problems)
        steps.append(int(numbers[0]))
        radii.append([int(number) for number in numbers[1:]])
    for what, values in (("distances", distances), ("voltage steps", steps)):
        if sorted(set(values)) != list(values):
            problems.append(Problem(f"{what} do not ascend", where=where, got=str(values)))
    if problems:
        raise SourceError.of(problems)
    return LensTable(tuple(steps), tuple(distances), np.array(radii, np.int64))


def pair_difference(table: LensTable, first: int, second: int, near: float, far: float) -> StepPair:
    """Return how two steps' blur radii differ over a range of distances (a row of Table 7.5).

    Parameters
    ----------
    table : LensTable
        The measured lens.
    first, second : int
        Voltage steps.
    near, far : float
        The range in metres, both ends included.

    Raises
    ------
    InputError
        Where the table lacks a step, or has fewer than two distances in the range.

    Examples
    --------
    >>> pair_difference(read_lens_table(), 141, 129, 1.5, 2.2).differences
    (1, 1, 2, 2, 3, 3, 3, 4)
    """
    within = _distances_within(table, near, far)
    distances = tuple(table.distances[place] for place in within)
    radii = [table.radius_at(step, distances) for step in (first, second)]
    differences = np.abs(radii[0] - radii[1]).astype(np.int64)
    return StepPair(max(first, second), min(first, second), distances, tuple(differences.tolist()))


def rank_pairs(table: LensTable, near: float, far: float) -> tuple[StepPair, ...]:
    """Return the usable pairs of voltage steps, best first, by the thesis's criteria (7.2.3).

    A pair is usable where the difference of its blur radii is monotonic over the range and not
    constant. Better is one that repeats fewer values, then the larger span, then the shorter
    longest run of one value, then the more even growth, then the lesser blur.

    Parameters
    ----------
    table : LensTable
        The measured lens.
    near, far : float
        The range in metres, both ends included.

    Examples
    --------
    >>> [pair.name for pair in rank_pairs(read_lens_table(), 1.5, 2.2)[:3]]
    ['140-130', '141-130', '141-129']
    """
    pairs = [
        pair_difference(table, second, first, near, far)
        for first, second in combinations(table.steps, 2)
    ]
    usable = [pair for pair in pairs if pair.monotonic and pair.span > 0]
    return tuple(sorted(usable, key=_merit))


def _merit(pair: StepPair) -> tuple[float, ...]:
    even = np.linspace(pair.differences[0], pair.differences[-1], len(pair.differences))
    unevenness = float(np.round(np.square(even - pair.differences).sum(), 9))
    return (
        pair.repeats,
        -pair.span,
        pair.longest_run,
        unevenness,
        sum(pair.differences),
        -pair.first,
        -pair.second,
    )


def _distances_within(table: LensTable, near: float, far: float) -> list[int]:
    # A nanometre of slack: 1.6 typed and 1.6 read are the same distance.
    within = [n for n, d in enumerate(table.distances) if near - 1e-9 <= d <= far + 1e-9]
    if len(within) < 2:
        ends = f"{table.distances[0]:g} to {table.distances[-1]:g} m"
        raise InputError(
            "fewer than two measured distances in the range",
            where="--range",
            expected=f"within {ends}",
            got=f"{near:g} to {far:g} m",
        )
    return within


def _whole_numbers(cells: list[str], where: str, problems: list[Problem]) -> list[float]:
    numbers = _numbers(cells, where, problems)
    if any(number != int(number) or not 0 <= number <= _MOST for number in numbers):
        problems.append(
            Problem(
                "not whole pixels",
                where=where,
                expected=f"0, 1, 2, ... {_MOST}",
                got=",".join(cells),
            )
        )
    return numbers


def _numbers(cells: list[str], where: str, problems: list[Problem]) -> list[float]:
    numbers = []
    for cell in cells:
        try:
            number = float(cell)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            problems.append(Problem("not a number", where=where, got=cell))
            number = 0.0
        numbers.append(number)
    return numbers


def _range_text(steps: tuple[int, ...]) -> str:
    return f"{steps[0]} to {steps[-1]}"
