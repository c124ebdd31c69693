"""A measured lens: its blur by voltage step and distance, and its pairs of steps."""

import csv
import math
from dataclasses import dataclass
from itertools import combinations, groupby
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.errors import InputError, Problem, SourceError
from dfdbench.system.files import read_text_as, shipped

_TABLE = "realworld-1/lens_blur_radius_px.csv"
#: More steps than any lens has, and more pixels of blur than any image.
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
            In metres; the end values hold beyond the ends of the table.

        Raises
        ------
        InputError
            If the table has no such step.
        """
        if step not in self.steps:
            ends = f"{self.steps[0]} to {self.steps[-1]}"
            raise InputError(f"the lens table has voltage steps {ends}, not {step}")
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
        """The name as the thesis writes it: 141-129."""
        return f"{self.first}-{self.second}"

    @property
    def monotonic(self) -> bool:
        """Whether the difference never turns, as the thesis requires of a pair."""
        ordered = sorted(self.differences)
        return list(self.differences) in (ordered, ordered[::-1])

    @property
    def repeats(self) -> int:
        """How many distances have the same difference as an earlier one; 0 is best."""
        return len(self.differences) - len(set(self.differences))

    @property
    def span(self) -> int:
        """Largest less smallest difference, in pixels."""
        return max(self.differences) - min(self.differences)

    @property
    def longest_run(self) -> int:
        """The length of the longest run of distances with the same difference."""
        return max(len(list(run)) for _, run in groupby(self.differences))


def read_lens_table(path: Path | None = None) -> LensTable:
    """Read a lens table: a heading ``step,DISTANCE,...`` in metres, then one row per voltage step.

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
    text = read_text_as(SourceError, path or shipped("manifests") / _TABLE, "the lens table")
    return parse_lens_table(text, str(path or _TABLE))


def parse_lens_table(text: str, where: str) -> LensTable:
    """Parse a lens table; `where` names the file in errors.

    Raises
    ------
    SourceError
        With every problem of the text.
    """
    read = csv.reader(text.splitlines())
    (_, heading), *rows = [(read.line_num, row) for row in read if row] or [(1, [""])]
    if not rows or heading[0].strip() != "step" or len(heading) < 3:
        raise SourceError("not a lens table", where=where, expected=_LAYOUT)
    problems: list[Problem] = []
    distances = _numbers(heading[1:], f"{where}: heading", problems)
    table = []
    for line, row in rows:
        place = f"{where}: line {line}"
        if len(row) != len(heading):
            what = f"{len(row)} cells under a heading of {len(heading)}"
            problems.append(Problem(what, where=place))
        elif numbers := _numbers(row, place, problems):
            if not all(number.is_integer() for number in numbers):
                problems.append(Problem("not whole steps and pixels", where=place, got=str(row)))
            table.append([int(number) for number in numbers])
    steps = [row[0] for row in table]
    for what, values in (("distances", distances), ("voltage steps", steps)):
        if sorted(set(values)) != list(values):
            problems.append(Problem(f"{what} do not ascend", where=where, got=str(values)))
    SourceError.raise_if(problems)
    radius = np.array([row[1:] for row in table], np.int64)
    return LensTable(tuple(steps), tuple(distances), radius)


def _numbers(cells: list[str], where: str, problems: list[Problem]) -> list[float]:
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        numbers = [math.nan]
    if all(0 <= number <= _MOST for number in numbers):
        return numbers
    problems.append(Problem(f"not numbers of 0 to {_MOST}", where=where, got=",".join(cells)))
    return []


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
        If the table lacks a step, or has fewer than two distances in the range.

    Examples
    --------
    >>> pair_difference(read_lens_table(), 141, 129, 1.5, 2.2).differences
    (1, 1, 2, 2, 3, 3, 3, 4)
    """
    # Allow a nanometre of slack: 1.6 typed and 1.6 read are the same distance.
    distances = tuple(d for d in table.distances if near - 1e-9 <= d <= far + 1e-9)
    if len(distances) < 2:
        what = f"fewer than two measured distances in {near:g} to {far:g} m"
        apart = np.diff(table.distances).max()
        ends = f"{table.distances[0]:g} to {table.distances[-1]:g} m"
        fix = f"widen it: distances are measured {apart:g} m apart, {ends}"
        raise InputError(what, where="--range", fix=fix)
    radii = [table.radius_at(step, distances) for step in (first, second)]
    differences = np.abs(radii[0] - radii[1]).astype(np.int64)
    return StepPair(max(first, second), min(first, second), distances, tuple(differences.tolist()))


def rank_pairs(table: LensTable, near: float, far: float) -> tuple[StepPair, ...]:
    """Return the usable pairs of voltage steps, best first, by the thesis's criteria (7.2.3).

    A pair is usable if the difference of its blur radii is monotonic over the range and not
    constant. Better pairs repeat fewer values, then have a larger span, then a shorter longest
    run of one value, then more even growth, then less blur.

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
    shape = pair.repeats, -pair.span, pair.longest_run, unevenness
    return (*shape, sum(pair.differences), -pair.first, -pair.second)
