"""What our own methods with a `fit` share; `fit.py` calls the `fit` of any method."""

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
    """A method whose fit chooses how much the prior and its neighbours count for a pixel.

    Parameters
    ----------
    window : int or None
        Side of the square window in pixels that costs are summed over, odd; None leaves it to the
        fit.
    prior : bool
        Let the fit find out whether it helps to know how often training shows each depth.
    """

    #: Whether a median can be read from its costs.
    reads_out: ClassVar[bool] = True
    #: Whether more or less can be smoothed.
    smooths: ClassVar[bool] = True

    def __init__(self, window: int | None, prior: bool) -> None:
        self._with_prior = prior
        self._given_window = window
        #: What the fit chose; as usual before.
        self.chosen = AS_USUAL

    @abstractmethod
    def _solve(self, infocus: Image, images: Sequence[Image]) -> NDArray[np.float32]:
        """Return depth levels from an image in focus and the defocus images, shape (y, x)."""

    def window_in(self, image: Image) -> tuple[int, int]:
        """Return the window for an image: one that a fit chose on larger ones is cut to fit.

        Raises
        ------
        MethodError
            If the window that was given is larger than the image.
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
        """Return what was learned with what is chosen by it; to be called on a copy."""
        # Imported here and in the fits: they load half of scipy, for the fit alone.
        from dfdbench.methods.choices import Part, choose

        def solve(part: Part, chosen: Chosen) -> Array:
            self.chosen = chosen
            return self._solve(part.infocus, [part.defocus])

        smooth = self.smooths and not self._given_window
        found = choose(solve, captures, self._with_prior, smooth, self.reads_out, change)
        return learned | found.as_learned()


class Calibrated(Choosing):
    """A method that needs the blur: it is given, or measured on training pairs.

    Parameters
    ----------
    recipe : BlurRecipe, BlurLaw or None
        The blur; None leaves it to the fit.
    window, prior
        As of `Choosing`.

    Raises
    ------
    MethodError
        For a window or a prior that is none.
    """

    def __init__(
        self, recipe: Blur | None = None, window: int | None = None, prior: bool = True
    ) -> None:
        MethodError.raise_if(fit_problems(prior, window))
        super().__init__(window, prior)
        self._told = recipe
        #: What the fit measured of each defocus image; nothing if the blur was given, or before.
        self.calibrations: tuple[Calibration, ...] = ()

    @property
    def fit(self) -> Callable[[Sequence[TrainingPair]], Learned] | None:
        """Measures the blur law of training pairs; None if the blur was given."""
        return self._fit if self._told is None else None

    def restore(self, learned: dict[str, Any]) -> None:
        """Take back what `fit` returned."""
        learned = dict(learned)
        self.chosen = Chosen.taken_from(learned)
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
        # A stack leaves less to choose, and its fit takes long enough.
        if len(found) > 1:
            return learned
        trial = copy.copy(self)
        trial.calibrations = (replace(found[0], law=without_change(found[0].law)),)
        return trial._with_choices(learned, captures, ViewChange.of(found[0].law))


class Solver(Calibrated):
    """What solves with the blur of any number of defocus images: pairs, and focal stacks.

    Of a stack the fit measures one law for each defocus image, against the in-focus image, or if
    it is not in focus all over, against the stack's sharpest pixels; and it notes whether levels of
    training captures grow with distance, which says what covers what.

    Parameters
    ----------
    recipe, window, prior
        As of `Calibrated`.
    sure : bool
        Also say how sure it is, in levels: the spread of its costs about the answer, times the
        factor with which its intervals hold on training captures. So it is fitted even where the
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
        """Return depth levels, shape (y, x), of two images of uint8, (y, x, 3) or (y, x).

        And where it says how sure it is, sigma.
        """
        self._require(1)
        for name, image in (("infocus", infocus), ("defocus", defocus)):
            if image.dtype != np.uint8:
                raise InputError(f"{name}: expected uint8, got {image.dtype}")
        return self._sure.answer(*self._settled(infocus, [defocus]))

    def from_stack(self, stack: DataArray) -> Answer:
        """Return depth levels, shape (y, x), and where it says how sure it is, sigma.

        Raises
        ------
        MethodError
            If there are more or fewer defocus images than were fitted.
        """
        self._require(int((stack["role"] != "infocus").sum()))
        return self._sure.answer(*self._settled(*self._images_in(stack)))

    def warm_up(self, infocus: Image, defocus: Image) -> None:
        """Compile what the first call would compile."""
        part = (slice(max(32, self._given_window or 0)),) * 2
        self._settled(infocus[part].copy(), [defocus[part].copy()] * len(self.blurs))

    @abstractmethod
    def _solve(
        self, infocus: Image, images: Sequence[Image], posterior: Posterior | None = None
    ) -> NDArray[np.float32]:
        """Return depth levels, shape (y, x); tell `posterior` what every level costs."""

    def _settled(
        self, infocus: Image, images: Sequence[Image]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Return depth levels, and their spread if that is asked for; shape (y, x)."""
        from dfdbench.methods.rims import settle_rims

        posterior = self._posterior(infocus.shape[:2])
        levels = self._solve(infocus, images, posterior)
        raw = None if posterior is None else posterior.spread_about(levels)
        if len(images) > 1:
            way = self._farther_is_higher
            levels = settle_rims(self.blurs, infocus, images, levels, farther_is_higher=way)
        return levels, raw

    def _posterior(self, shape: tuple[int, ...]) -> Posterior | None:
        """Return what hears costs of an image of this shape; None if it says not how sure it is."""
        from dfdbench.methods.posterior import Posterior

        told = isinstance(self.blur, BlurRecipe)
        by = (_WINDOW, _SHARPNESS, _MOST_OF_RECIPE if told else _MOST_OF_LAW)
        return Posterior(shape, *by) if self._sure.asked else None

    def _require(self, count: int) -> None:
        known = len(self.blurs)
        if count != known:
            what = f"{count} defocus images, but the blur is known of {known}"
            fix = "leave recipe out, and fit the method to stacks like those that it gets"
            raise MethodError(what, where=type(self).__name__, fix=fix)
        if self._sure.asked:
            self._sure.require_factor()

    @property
    def fit(self) -> Callable[[Sequence[TrainingPair]], Learned] | None:
        """Measures the blur law of training captures if no blur was given, and how sure to be."""
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
        """Return a capture's image in focus, or what stands for it, and its defocus images."""
        if capture.is_pair:
            return capture.infocus, [capture.defocus]
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
#: Depth levels, float32 of shape (y, x), or a tuple of them and sigma: it depends on a parameter.
Answer = Any
Image = NDArray[np.uint8]
Fit = Callable[[Sequence[TrainingPair]], Learned]

# How costs say how sure a method is, as `Posterior` takes it: of windows of 7, 13 and 25 pixels,
# 1/4 to 16 a nat, and 2 to 10 nats at most, what told the training errors of the demo set and of a
# rendered one best. More nats let pixels that no level explains speak for a window; but a recipe
# knows of no noise, and its nats are cheap.
_WINDOW, _SHARPNESS, _MOST_OF_LAW, _MOST_OF_RECIPE = 13, 4.0, 3.0, 10.0

# What a fit learns to be so where levels grow with distance.
_TURNED = "farther_is_higher"
#: At most so many training pairs are read, evenly spread over all.
MOST_PAIRS = 64
REFIT = "fit the method again"
_USUAL_WINDOW = 7
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


def part_of(shape: tuple[int, ...], number: int, side: int) -> tuple[slice, slice]:
    """Return which part of an image to look at, another of each: left, middle, right, and so on.

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
    return [] if right else [wrong(name, f"an odd number from 1 to {most}", value)]


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


def fit_problems(prior: Any, window: Any) -> list[Problem]:
    """Return what is wrong with the parameters of a fit: true or false, and a window."""
    problems = [] if isinstance(prior, bool) else [wrong("prior", "true or false", prior)]
    return problems + ([] if window is None else odd_window("window", window))


def number_within(name: str, value: Any, most: float) -> list[Problem]:
    """Return what is wrong with a number that must be above 0, at most `most`."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    right = number and 0 < value <= most
    return [] if right else [wrong(name, f"above 0, at most {most:g}", value)]


def wrong(name: str, expected: str, got: Any) -> Problem:
    """Return the problem of a parameter."""
    return Problem("wrong parameter", where=name, expected=expected, got=repr(got))
