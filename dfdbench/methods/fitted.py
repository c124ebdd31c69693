"""What our own methods with a `fit` share."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LEVELS, BlurRecipe
from dfdbench.errors import InputError, MethodError, Problem
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.method import Learned, TrainingPair
from dfdbench.methods.readout import AS_USUAL, Chosen
from dfdbench.methods.view_change import ViewChange, without_change

if TYPE_CHECKING:
    from xarray import DataArray

    from dfdbench.methods.posterior import Posterior


class Choosing(ABC):
    """A method whose fit chooses how much a prior and the neighbours of a pixel count.

    Parameters
    ----------
    window : int or None
        Side in pixels of the square window over which costs are summed, odd; None leaves it to the
        fit.
    prior : bool
        Let the fit find out whether a prior of the depths in training helps.
    """

    #: Whether a median can be read from its costs.
    reads_out: ClassVar[bool] = True
    #: Whether its smoothing can be varied.
    smooths: ClassVar[bool] = True

    def __init__(self, window: int | None, prior: bool) -> None:
        self._with_prior = prior
        self._given_window = window
        #: What the fit chose; `AS_USUAL` before.
        self.chosen = AS_USUAL

    @abstractmethod
    def _solve(self, infocus: Image, images: Sequence[Image]) -> NDArray[np.float32]:
        """Return depth levels from an in-focus image and the defocus images, shape (y, x)."""

    def window_in(self, image: Image) -> tuple[int, int]:
        """Return the window for an image, reducing one that the fit chose on larger images.

        Raises
        ------
        MethodError
            If the user's window is larger than the image.
        """
        if given := self._given_window:
            require_window_fits(given, image, type(self).__name__)
            return given, given
        most = max((min(image.shape[:2]) - 1) // 2 * 2 + 1, _SMALL_WINDOW)
        side = min(_USUAL_WINDOW * self.chosen.smoothing // 2 * 2 + 1, most)
        return side, side

    def _with_choices(
        self, learned: Learned, captures: Sequence[TrainingPair], change: ViewChange | None = None
    ) -> Learned:
        """Return what was learned, plus the choices made with it."""
        # Imported here and in the fits because they load half of scipy, which only fits need.
        from dfdbench.methods.choices import Part, choose

        def solve(part: Part, chosen: Chosen) -> Array:
            trial = copy.copy(self)
            trial.chosen = chosen
            return trial._solve(part.infocus, [part.defocus])

        window = self._given_window or 0
        how = (self._with_prior, self.smooths and not window, self.reads_out, change, window)
        found = choose(solve, captures, *how)
        return learned | found.as_learned()


class Calibrated(Choosing):
    """A method that needs the blur, which is given or measured on training pairs.

    Parameters
    ----------
    recipe : BlurRecipe, BlurLaw or None
        The blur; None leaves it to the fit.
    window, prior
        As for `Choosing`.

    Raises
    ------
    MethodError
        If the window or the prior is invalid.
    """

    def __init__(
        self, recipe: Blur | None = None, window: int | None = None, prior: bool = True
    ) -> None:
        MethodError.raise_if(fit_problems(prior, window))
        super().__init__(window, prior)
        self._told = recipe
        #: What the fit measured for each defocus image; empty before, or if the blur was given.
        self.calibrations: tuple[Calibration, ...] = ()

    @property
    def fit(self) -> Callable[[Sequence[TrainingPair]], Learned] | None:
        """A function that measures the blur law of training pairs; None if the blur was given."""
        return self._fit if self._told is None else None

    def restore(self, learned: dict[str, Any]) -> None:
        """Take back what `fit` returned."""
        learned = dict(learned)
        try:
            self.chosen = Chosen.taken_from(learned)
        except ValueError as error:
            what = f"not what this method learns: {error}"
            raise MethodError(what, where=type(self).__name__, fix=REFIT) from error
        self.calibrations = Calibration.all_of(learned)

    @property
    def levels(self) -> int:
        """The number of depth levels of the blur."""
        return LEVELS if self._told is None else self._told.levels

    @property
    def blurs(self) -> tuple[Blur, ...]:
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
    def blur(self) -> Blur:
        """The blur of the only defocus image, or of the first."""
        return self.blurs[0]

    def _fit(self, pairs: Sequence[TrainingPair]) -> Learned:
        from dfdbench.methods.calibration import calibrate

        return self._learned([calibrate(pairs)], pairs)

    def _learned(self, found: Sequence[Calibration], captures: Sequence[TrainingPair]) -> Learned:
        learned = Calibration.all_as_learned(found)
        # A stack leaves less to choose, and its fit is slow enough.
        if len(found) > 1:
            return learned
        trial = copy.copy(self)
        trial.calibrations = (replace(found[0], law=without_change(found[0].law)),)
        return trial._with_choices(learned, captures, ViewChange.of(found[0].law))


class Solver(Calibrated):
    """A method that uses the blur of one or more defocus images: of pairs or focal stacks.

    For a stack, the fit measures one law for each defocus image, against the in-focus image or, if
    that is not in focus everywhere, against the stack's sharpest pixels. It also notes whether the
    levels of training captures grow with distance, which says what occludes what.

    Parameters
    ----------
    recipe, window, prior
        As for `Calibrated`.
    sure : bool
        Also return how sure it is, in levels: the spread of its costs around the answer, times the
        factor that makes its intervals hold on training captures. It is then fitted even if the
        blur is given.
    """

    _farther_is_higher = False

    def __init__(
        self, recipe: Blur | None, window: int | None = None, prior: bool = True, sure: bool = False
    ) -> None:
        from dfdbench.methods.spread import Sureness

        super().__init__(recipe, window, prior)
        if not isinstance(sure, bool):
            raise MethodError.of(wrong("sure", "true or false", sure))
        self._sure = Sureness(sure, type(self).__name__)

    def __call__(self, infocus: Image, defocus: Image) -> Answer:
        """Return depth levels, shape (y, x), for two images of uint8, (y, x, 3) or (y, x).

        With `sure`, return depth levels and sigma.
        """
        self._require(1)
        for name, image in (("infocus", infocus), ("defocus", defocus)):
            if image.dtype != np.uint8:
                raise InputError(f"{name}: expected uint8, got {image.dtype}")
        return self._sure.answer(*self._settled(infocus, [defocus]))

    def from_stack(self, stack: DataArray) -> Answer:
        """Return depth levels, shape (y, x), and, with `sure`, sigma.

        Raises
        ------
        MethodError
            If the number of defocus images differs from those whose blur is known.
        """
        self._require(int((stack["role"] != "infocus").sum()))
        return self._sure.answer(*self._settled(*self._images_in(stack)))

    def warm_up(self, infocus: Image, defocus: Image) -> None:
        """Compile the code that the first call would compile."""
        part = (slice(max(32, self._given_window or 0)),) * 2
        self._settled(infocus[part].copy(), [defocus[part].copy()] * len(self.blurs))

    @abstractmethod
    def _solve(
        self, infocus: Image, images: Sequence[Image], posterior: Posterior | None = None
    ) -> NDArray[np.float32]:
        """Return depth levels, shape (y, x), and add every level's costs to `posterior`."""

    def _settled(
        self, infocus: Image, images: Sequence[Image]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Return depth levels and, with `sure`, their spread; shape (y, x)."""
        from dfdbench.methods.rims import settle_rims

        posterior = self._posterior(infocus.shape[:2])
        levels = self._solve(infocus, images, posterior)
        raw = None if posterior is None else posterior.spread_about(levels)
        if len(images) > 1:
            way = self._farther_is_higher
            levels = settle_rims(self.blurs, infocus, images, levels, farther_is_higher=way)
        return levels, raw

    def _posterior(self, shape: tuple[int, ...]) -> Posterior | None:
        """Return the posterior that collects costs for an image of this shape, if `sure`."""
        from dfdbench.methods.posterior import Posterior

        told = isinstance(self.blur, BlurRecipe)
        by = (_WINDOW, _SHARPNESS, _MOST_OF_RECIPE if told else _MOST_OF_LAW)
        return Posterior(shape, *by) if self._sure.asked else None

    def _require(self, count: int) -> None:
        known = len(self.blurs)
        if count != known:
            what = f"{count} defocus images, but the blur is known of {known}"
            fix = "leave recipe out, and " * (self._told is not None)
            fix += "fit the method to captures with as many images as those that it gets"
            raise MethodError(what, where=type(self).__name__, fix=fix)
        if self._sure.asked:
            self._sure.require_factor()

    @property
    def fit(self) -> Callable[[Sequence[TrainingPair]], Learned] | None:
        """A function that measures the blur law, unless it was given, and how sure to be."""
        return self._fit if self._told is None or self._sure.asked else None

    def _fit(self, pairs: Sequence[TrainingPair]) -> Learned:
        from dfdbench.methods.calibration import calibrate_images
        from dfdbench.methods.stacks import farther_is_higher

        learned: Learned = {}
        if self._told is None:
            found = calibrate_images(pairs)
            turned = len(found) > 1 and farther_is_higher(pairs)
            learned = self._learned(found, pairs) | ({_TURNED: 1} if turned else {})
        if not self._sure.asked:
            return learned
        trial = copy.copy(self)
        trial.restore(learned)

        def answer(capture: TrainingPair) -> tuple[Array, Any]:
            return trial._settled(*self._images_of(capture))

        return learned | self._sure.learned_on(answer, pairs)

    def _images_of(self, capture: TrainingPair) -> tuple[Image, list[Image]]:
        """Return a capture's in-focus image, or what replaces it, and its defocus images."""
        return self._images_in(capture.stack)

    def _images_in(self, stack: DataArray) -> tuple[Image, list[Image]]:
        from dfdbench.methods.stacks import sharp_and_blurred

        return sharp_and_blurred(stack, [found.change for found in self.calibrations])

    def restore(self, learned: dict[str, Any]) -> None:
        """Take back what `fit` returned."""
        learned = dict(learned)
        self._sure = self._sure.restored(learned)
        self._farther_is_higher = bool(learned.pop(_TURNED, False))
        if self._told is None:
            super().restore(learned)


Array = NDArray[Any]
#: How defocus images were made.
Blur = BlurRecipe | BlurLaw
#: Depth levels, float32 of shape (y, x), or a tuple of them and sigma, depending on a parameter.
Answer = Any
Image = NDArray[np.uint8]
Fit = Callable[[Sequence[TrainingPair]], Learned]

# The arguments of `Posterior` that best predicted the training errors of the demo set and of a
# rendered one, among windows of 7, 13 and 25 pixels, sharpnesses of 1/4 to 16 per nat and limits of
# 2 to 10 nats. With more nats, pixels that no level explains dominate a window. But a recipe knows
# no noise, so its nats mean less.
_WINDOW, _SHARPNESS, _MOST_OF_LAW, _MOST_OF_RECIPE = 13, 4.0, 3.0, 10.0

# The name under which a fit keeps whether levels grow with distance.
_TURNED = "farther_is_higher"
#: The most training pairs that are read, evenly spread over all.
MOST_PAIRS = 64
REFIT = "fit the method again"
_USUAL_WINDOW = 7
# The largest default.
_SMALL_WINDOW = 9
# The number of entries in a table of depths, and of pixels per pair that go into it.
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


def part_of(shape: tuple[int, ...], number: int, side: int) -> tuple[slice, slice]:
    """Return which part of the image with this number to use: left, middle, right, and so on.

    Examples
    --------
    >>> [part_of((9, 30), number, 10)[1] for number in (0, 1)]
    [slice(0, 10, None), slice(10, 20, None)]
    """
    rows, columns = (
        (size - min(size, side)) * (turn % 3) // 2
        for size, turn in zip(shape, (number // 3, number), strict=True)
    )
    return slice(rows, rows + side), slice(columns, columns + side)


def not_fitted(method: str) -> MethodError:
    """Return the error for a method that was neither given the blur nor fitted."""
    what = "the method knows no blur yet"
    fix = "give recipe=NAME, or call fit(captures) of what dfdbench.load_method returns"
    return MethodError(what, where=method, fix=fix)


def nothing_to_fit(method: str, expected: str, got: str) -> MethodError:
    """Return the error for a method that cannot be fitted to these pairs."""
    return MethodError("nothing to fit to", where=method, expected=expected, got=got)


def learned_array(learned: Learned, name: str, method: str, dimensions: int) -> Array:
    """Return an array that a fit learned, as float64.

    Raises
    ------
    MethodError
        If it is missing, has other dimensions, or is not finite.
    """
    found = np.asarray(learned.get(name, ()), np.float64)
    if found.ndim != dimensions or not found.size or not np.isfinite(found).all():
        what = f"not what this method learns: {dimensions} dimensions of finite numbers"
        raise MethodError(what, where=f"{method}: {name}", fix=REFIT)
    return found


def depth_table(
    measure: Callable[[Image, Image], Array], pairs: Sequence[TrainingPair], method: str
) -> Learned:
    """Learn which depth goes with each value of a method's measure.

    The known pixels of the training pairs are sorted by the measure and divided into groups of
    equal size; a group's median depth goes with its mean measure. Nothing is assumed about the
    curve, not even that it rises.

    Parameters
    ----------
    measure : callable
        ``measure(infocus, defocus)``, float, shape (y, x).
    pairs : sequence
        Training pairs.
    method : str
        The method's name, for errors.

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
    measured, depth = table_of(measures, depths)
    if not depth.size:
        raise nothing_to_fit(method, "training pairs with known depth", "none")
    return {"measure": measured, "depth": depth}


def table_of(measures: Sequence[Array], depths: Sequence[Array]) -> tuple[Array, Array]:
    """Return the table that `depth_table` learns, from each pair's measures and depths."""
    measured, depth = np.concatenate([[], *measures]), np.concatenate([[], *depths])
    order = np.argsort(measured, kind="stable")
    groups = np.array_split(order, min(_ENTRIES, depth.size)) if depth.size else []
    means = np.array([measured[group].mean() for group in groups])
    return means, np.array([np.median(depth[group]) for group in groups])


def channels_of(image: Image) -> NDArray[np.float32]:
    """Return an image as float32 with a channel axis, shape (y, x, channel)."""
    return np.atleast_3d(image).astype(np.float32)


def odd_window(name: str, value: Any, most: int = 255) -> list[Problem]:
    """Return the problem if a window's side in pixels is not odd, positive and at most `most`."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    right = whole and 0 < value <= most and value % 2
    return [] if right else [wrong(name, f"an odd number from 1 to {most}", value)]


def require_window_fits(window: int, image: Image, method: str) -> None:
    """Raise if a window is larger than the image, when it would mostly see copies of the edge.

    Raises
    ------
    MethodError
        If a side of the image is shorter. Windows of up to 9 pixels pass, so that the defaults work
        on any image.

    Examples
    --------
    >>> require_window_fits(7, np.zeros((7, 9, 3), np.uint8), "mine")
    """
    height, width = image.shape[:2]
    if window > max(min(height, width), _SMALL_WINDOW):
        what = f"the window is larger than the image, {window} of {height} x {width} pixels"
        raise MethodError(what, where=f"{method}: window")


def fit_problems(prior: Any, window: Any) -> list[Problem]:
    """Return the problems of a fit's parameters: the prior must be a bool, the window valid."""
    problems = [] if isinstance(prior, bool) else [wrong("prior", "true or false", prior)]
    return problems + ([] if window is None else odd_window("window", window))


def number_within(name: str, value: Any, most: float, zero: bool = False) -> list[Problem]:
    """Return the problem of a number that is not above 0, or `zero`, and at most `most`."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    right = number and (0 < value <= most or (zero and value == 0))
    return [] if right else [wrong(name, f"above 0, at most {most:g}{', or 0' * zero}", value)]


def wrong(name: str, expected: str, got: Any) -> Problem:
    """Return the problem for a wrong parameter."""
    return Problem("wrong parameter", where=name, expected=expected, got=repr(got))
