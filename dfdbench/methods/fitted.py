"""What our own methods with a `fit` share; `fit.py` calls the `fit` of any method."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LEVELS, BlurRecipe
from dfdbench.errors import MethodError, Problem
from dfdbench.methods.method import Learned, TrainingPair

if TYPE_CHECKING:
    from xarray import DataArray

    from dfdbench.methods.measured_law import Calibration


def least_label(costs: NDArray[Any]) -> NDArray[np.float64]:
    """Return each pixel's label of least cost, refined to a fraction of a label.

    The fraction is the minimum of a parabola through the least cost and those beside it. The
    first and the last label stay whole, and so does one whose neighbours cost the same.

    Parameters
    ----------
    costs : ndarray, shape (label, y, x)
        Of any real type.

    Returns
    -------
    ndarray of float64, shape (y, x)
        0 to the number of labels less one.

    Examples
    --------
    >>> least_label(np.array([9, 1, 3, 9]).reshape(4, 1, 1)).tolist()
    [[1.3]]
    """
    labels = costs.argmin(axis=0)
    inner = np.clip(labels, 1, max(len(costs) - 2, 1))
    if len(costs) < 3:
        return np.asarray(labels, np.float64)
    before, least, after = (
        np.take_along_axis(costs, (inner + step)[np.newaxis], 0)[0].astype(np.float64)
        for step in (-1, 0, 1)
    )
    bend = before - 2 * least + after
    fits = (labels == inner) & (bend > 0)
    fraction = np.divide(before - after, 2 * bend, out=np.zeros(bend.shape), where=fits)
    return np.asarray(labels + fraction)


def read_out(costs: Array, sharpness: float) -> NDArray[np.float64]:
    """Return each pixel's label from costs in nats, shape (label, y, x).

    Parameters
    ----------
    costs : ndarray
        The prior's among them.
    sharpness : float
        See `DepthPrior`.

    Examples
    --------
    >>> costs = np.array([0.0, 0.1, 0.2, 5.0]).reshape(4, 1, 1)
    >>> read_out(costs, 0).tolist(), read_out(costs, 1).round(2).tolist()
    ([[0.0]], [[0.9]])
    """
    if not sharpness:
        return least_label(costs)
    least = costs.min(axis=0)
    total = np.zeros(least.shape)
    sums = np.empty(costs.shape, np.float32)
    for label, cost in enumerate(costs):
        total += np.exp(-sharpness * (cost - least))
        sums[label] = total
    half = total / 2
    label = (sums < half).sum(axis=0)
    after = np.take_along_axis(sums, label[np.newaxis], 0)[0]
    before = np.take_along_axis(sums, np.maximum(label - 1, 0)[np.newaxis], 0)[0]
    before = np.where(label > 0, before, 0)
    # Each label's share lies evenly over its place, half a label to either side.
    part = np.divide(
        half - before, after - before, out=np.full(half.shape, 0.5), where=after > before
    )
    return np.asarray(np.clip(label + part - 0.5, 0, len(costs) - 1))


@dataclass(frozen=True)
class DepthPrior:
    """What each level costs beside the images, and how a volume of costs is read.

    Parameters
    ----------
    energy : ndarray of float64, shape (level,)
        Nats; all 0 where no prior helps.
    sharpness : float
        0 for the level of least cost; else the median of ``exp(-sharpness * cost)``.
    weight : float
        What the histogram's logarithm was multiplied with.
    """

    energy: NDArray[np.float64]
    sharpness: float = 0.0
    weight: float = 0.0

    def as_learned(self) -> Learned:
        """Return it as a method's fit returns it."""
        return {"prior": self.energy, "sharpness": self.sharpness, "prior_weight": self.weight}

    def weigh_in(self, costs: Array, levels: Any = slice(None)) -> None:
        """Add itself to costs of no known unit, shape (label, y, x), where they lie.

        Their unit is taken to be the image's median of the least cost.

        Parameters
        ----------
        costs : ndarray of float32
        levels : ndarray of int, optional
            The level of each label; default: they are the same.
        """
        if self.weight:
            costs /= max(float(np.median(costs.min(axis=0))), 1e-12)
            costs += self.energy[levels, np.newaxis, np.newaxis].astype(np.float32)

    @classmethod
    def taken_from(cls, learned: Learned) -> DepthPrior:
        """Take it out of what a fit learned; without it there is none."""
        if "prior" not in learned:
            return NO_PRIOR
        energy = np.asarray(learned.pop("prior"), np.float64)
        return cls(energy, float(learned.pop("sharpness")), float(learned.pop("prior_weight")))


#: No prior, and the level of least cost.
NO_PRIOR = DepthPrior(np.zeros(LEVELS))


class Calibrated(ABC):
    """A method that needs the blur: it is given, or measured on training pairs.

    Parameters
    ----------
    recipe : BlurRecipe, BlurLaw or None
        The blur; None leaves it to the fit.
    prior : bool
        Let the fit find out whether it helps to know how often training shows each depth.

    Raises
    ------
    MethodError
        If `prior` is true and the blur is given, so that nothing is fitted.
    """

    #: Whether a median can be read from its costs.
    reads_out: ClassVar[bool] = True

    @abstractmethod
    def _solve(self, infocus: Image, images: Sequence[Image]) -> NDArray[np.float32]:
        """Return depth levels from an image in focus and the defocus images, shape (y, x)."""

    def __init__(self, recipe: BlurRecipe | BlurLaw | None, prior: bool = False) -> None:
        MethodError.raise_if(prior_problems(prior))
        if prior and recipe is not None:
            what = "prior=true is for a fit, and the blur is given"
            fix = "add --param recipe=null, so that the method is fitted, or leave prior out"
            raise MethodError(what, where="prior", fix=fix)
        self._told = recipe
        self._with_prior = prior
        self.prior = NO_PRIOR
        #: What the fit measured of each defocus image; nothing if the blur was given, or before.
        self.calibrations: tuple[Calibration, ...] = ()

    @property
    def calibration(self) -> Calibration | None:
        """What the fit measured on pairs."""
        return self.calibrations[0] if len(self.calibrations) == 1 else None

    @property
    def fit(self) -> Callable[[Sequence[TrainingPair]], Learned] | None:
        """Measures the blur law of training pairs; None if the blur was given."""
        return self._fit if self._told is None else None

    def restore(self, learned: dict[str, Any]) -> None:
        """Take back what `fit` returned."""
        # Imported here and in the fit: it loads half of scipy, for the fit alone.
        from dfdbench.methods.measured_law import Calibration

        learned = dict(learned)
        self.prior = DepthPrior.taken_from(learned)
        self.calibrations = Calibration.all_of(learned)

    @property
    def levels(self) -> int:
        """The number of depth levels of the blur."""
        return LEVELS if self._told is None else self._told.levels

    @property
    def blurs(self) -> tuple[BlurRecipe | BlurLaw, ...]:
        """The blur of each defocus image.

        Raises
        ------
        MethodError
            If it was neither given nor measured.
        """
        if self._told is not None:
            return (self._told,)
        if not self.calibrations:
            raise not_fitted(type(self).__name__)
        return tuple(found.law for found in self.calibrations)

    @property
    def blur(self) -> BlurRecipe | BlurLaw:
        """The blur of the only defocus image, or of the first."""
        return self.blurs[0]

    def _fit(self, pairs: Sequence[TrainingPair]) -> Learned:
        from dfdbench.methods.calibration import calibrate

        return self._learned([calibrate(pairs)], pairs)

    def _learned(self, found: Sequence[Calibration], captures: Sequence[TrainingPair]) -> Learned:
        from dfdbench.methods.depth_prior import Part, choose_prior
        from dfdbench.methods.measured_law import Calibration
        from dfdbench.methods.view_change import ViewChange, without_change

        learned = Calibration.all_as_learned(found)
        if not self._with_prior:
            return learned
        changes = [ViewChange.of(one.law) for one in found]
        trial = copy.copy(self)
        trial.calibrations = tuple(replace(one, law=without_change(one.law)) for one in found)

        def solve(part: Part, prior: DepthPrior) -> Array:
            trial.prior = prior
            return trial._solve(part.infocus, part.images)

        return learned | choose_prior(solve, captures, self.reads_out, changes).as_learned()


class Solver(Calibrated):
    """What solves with the blur of any number of defocus images: pairs, and focal stacks.

    Of a stack the fit measures one law for each defocus image, against the in-focus image, or if
    there is none, against the sharpest pixels of the others; and it notes whether the levels of the
    training captures grow with distance, which says what covers what.
    """

    _farther_is_higher = False

    def __call__(self, infocus: Image, defocus: Image) -> NDArray[np.float32]:
        """Return depth levels, shape (y, x), of two images of uint8, (y, x, 3) or (y, x)."""
        self._require(1)
        return self._solve(infocus, [defocus])

    def from_stack(self, stack: DataArray) -> NDArray[np.float32]:
        """Return depth levels, shape (y, x).

        Raises
        ------
        MethodError
            If there are more or fewer defocus images than were fitted.
        """
        from dfdbench.methods.stacks import sharp_and_blurred

        infocus, images = sharp_and_blurred(stack)
        self._require(len(images))
        return self._settled(infocus, images)

    def warm_up(self, infocus: Image, defocus: Image) -> None:
        """Compile what the first call would compile."""
        self._settled(infocus[:32, :32].copy(), [defocus[:32, :32].copy()] * len(self.blurs))

    def _settled(self, infocus: Image, images: Sequence[Image]) -> NDArray[np.float32]:
        from dfdbench.methods.rims import settle_rims

        levels = self._solve(infocus, images)
        if len(images) == 1:
            return levels
        way = self._farther_is_higher
        return settle_rims(self.blurs, infocus, images, levels, farther_is_higher=way)

    def _require(self, count: int) -> None:
        known = len(self.blurs)
        if count != known:
            what = f"{count} defocus images, but the blur is known of {known}"
            fix = "leave recipe out, and fit the method to stacks like those that it gets"
            raise MethodError(what, where=type(self).__name__, fix=fix)

    def _fit(self, pairs: Sequence[TrainingPair]) -> Learned:
        from dfdbench.methods.calibration import calibrate_images
        from dfdbench.methods.stacks import farther_is_higher

        found = calibrate_images(pairs)
        turned = len(found) > 1 and farther_is_higher(pairs)
        return self._learned(found, pairs) | ({_TURNED: 1} if turned else {})

    def restore(self, learned: dict[str, Any]) -> None:
        """Take back what `fit` returned."""
        learned = dict(learned)
        self._farther_is_higher = bool(learned.pop(_TURNED, False))
        super().restore(learned)


Array = NDArray[Any]
Image = NDArray[np.uint8]
Fit = Callable[[Sequence[TrainingPair]], Learned]

# What a fit learns to be so where levels grow with distance.
_TURNED = "farther_is_higher"
#: At most so many training pairs are read, evenly spread over all.
MOST_PAIRS = 64
REFIT = "fit the method again"
# The largest default.
_SMALL_WINDOW = 9
# Entries of a table of depths, and pixels of a pair that go into it.
_ENTRIES = 256
_PIXELS = 20_000


def evenly_spread(count: int, most: int = MOST_PAIRS) -> list[int]:
    """Return the indices of at most `most` of `count` things, evenly spread.

    Examples
    --------
    >>> evenly_spread(10, 4), evenly_spread(2, 4)
    ([1, 3, 6, 8], [0, 1])
    """
    number = min(count, most)
    return [(2 * index + 1) * count // (2 * number) for index in range(number)]


def not_fitted(method: str) -> MethodError:
    """Return the error of a method that was neither given the blur nor fitted."""
    what = "the method knows no blur yet"
    fix = "give recipe=NAME, or call restore(fit(pairs)) first"
    return MethodError(what, where=method, fix=fix)


def nothing_to_fit(method: str, expected: str, got: str) -> MethodError:
    """Return the error of a method that cannot be fitted to these pairs."""
    return MethodError("nothing to fit to", where=method, expected=expected, got=got)


def learned_array(learned: Learned, name: str, method: str, dimensions: int) -> Array:
    """Return an array of what a fit learned, as float64.

    Raises
    ------
    MethodError
        If it is not there, of other dimensions, or not finite.
    """
    found = np.asarray(learned.get(name, ()), np.float64)
    if found.ndim != dimensions or not found.size or not np.isfinite(found).all():
        what = f"not what this method learns: {dimensions} dimensions of finite numbers"
        raise MethodError(what, where=f"{method}: {name}", fix=REFIT)
    return found


def depth_table(
    measure: Callable[[Image, Image], Array], pairs: Sequence[TrainingPair], method: str
) -> Learned:
    """Learn which depth goes with what a method measures.

    The known pixels of the training pairs are sorted by what is measured there and cut into
    groups of equal number; a group's median depth goes with its mean measure. Nothing is assumed
    of the curve, not even that it rises.

    Parameters
    ----------
    measure : callable
        ``measure(infocus, defocus)``, float, shape (y, x).
    pairs : sequence
        Training pairs.
    method : str
        Its name, for errors.

    Returns
    -------
    dict
        ``measure``, ascending, and ``depth``: one-dimensional, of equal length.

    Raises
    ------
    MethodError
        If no pair has a pixel of known depth.
    """
    measures, depths = [], []
    for index in evenly_spread(len(pairs)):
        pair = pairs[index]
        known = np.flatnonzero(pair.valid)
        known = known[evenly_spread(known.size, _PIXELS)]
        measures.append(measure(pair.infocus, pair.defocus).ravel()[known])
        depths.append(pair.levels.ravel()[known])
    measured, depth = np.concatenate([[], *measures]), np.concatenate([[], *depths])
    if not depth.size:
        raise nothing_to_fit(method, "training pairs with known depth", "none")
    groups = np.array_split(np.argsort(measured, kind="stable"), min(_ENTRIES, depth.size))
    return {
        "measure": np.array([measured[group].mean() for group in groups]),
        "depth": np.array([np.median(depth[group]) for group in groups]),
    }


def channels_of(image: Image) -> NDArray[np.float32]:
    """Return an image in float32 with an axis of channels, shape (y, x, channel)."""
    return np.atleast_3d(image).astype(np.float32)


def odd_window(name: str, value: Any, most: int = 255) -> list[Problem]:
    """Return what is wrong with the side of a window in pixels: odd, positive, at most `most`."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    right = whole and 0 < value <= most and value % 2
    return [] if right else [wrong(name, f"odd, 1 to {most}", value)]


def require_window_fits(window: int, image: Image, method: str) -> None:
    """Refuse a window that is larger than the image: it would see little but copies of its edge.

    Raises
    ------
    MethodError
        If a side of the image is shorter; windows of up to 9 pixels pass, so that with the
        defaults any image has a depth map.

    Examples
    --------
    >>> require_window_fits(7, np.zeros((7, 9, 3), np.uint8), "mine")
    """
    height, width = image.shape[:2]
    if window > max(min(height, width), _SMALL_WINDOW):
        what = f"the window is larger than the image, {window} of {height} x {width} pixels"
        raise MethodError(what, where=f"{method}: window")


def prior_problems(value: Any) -> list[Problem]:
    """Return what is wrong with the parameter `prior`: true or false."""
    return [] if isinstance(value, bool) else [wrong("prior", "true or false", value)]


def number_within(name: str, value: Any, low: float, high: float) -> list[Problem]:
    """Return what is wrong with a number that must be above `low`, at most `high`."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    right = number and low < value <= high
    return [] if right else [wrong(name, f"above {low:g}, at most {high:g}", value)]


def wrong(name: str, expected: str, got: Any) -> Problem:
    """Return the problem of a parameter."""
    return Problem("wrong parameter", where=name, expected=expected, got=repr(got))
