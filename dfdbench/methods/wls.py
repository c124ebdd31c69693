"""Blur that pixels with texture lend to those without, as far as the image's edges."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import MethodError
from dfdbench.methods import fitted
from dfdbench.methods.choices import Part, cut_out, groups_of
from dfdbench.methods.edges import lent_within_edges
from dfdbench.methods.method import Learned, TrainingPair
from dfdbench.methods.readout import Choice
from dfdbench.methods.s_transform import laplacian_and_difference
from dfdbench.system.compiled import in_threads

_NAME = "wls"
# In squared grey levels a square pixel: where the Laplacian has less, there is no texture. What is
# measured there hardly counts.
_NO_TEXTURE = 1e-3
# What the fit tries on how many training captures, evenly among all, and on how many pixels of
# each: smoothing first and the window, the smallest first, with each strength.
_MEASURES = ((2.5, 9), (1.0, 15), (0.5, 31))
_STRENGTHS = (0.0, 1e1, 1e2, 1e3, 1e4, 1e5)
_MOST = 1e9
_LOOKED_AT, _PIXELS = 16, 5_000
# Of larger captures the choice is made on a part with this side: all parts are held at once.
_SIDE = 640

Array = NDArray[Any]


class WeightedLeastSquares:
    """Depth from the blur's variance, smoothed within the in-focus image's edges.

    The variance v that the blur adds is measured as by `STransform`, in small windows. Then each
    pixel's answer u is a mean of the v around it, which counts the more the more texture there is,
    and the less the more edges lie between. A table from training captures turns u into depth. The
    fit also chooses smoothing, window and strength, by the least absolute error on training
    captures whose group the table has not seen.

    Parameters
    ----------
    contrast : float
        The difference of two neighbours, in grey levels, the mean over channels, at which the tie
        between them falls to 1 / e. From 2 to 5 it makes little difference on training captures of
        DFD indoor.

    Raises
    ------
    MethodError
        For a contrast out of range; at a call before a fit.

    Notes
    -----
    With w for the root of the mean squared Laplacian, u is the quotient of w v and w, both smoothed
    by `within_edges`: Min et al., Fast global image smoothing based on weighted least squares, TIP
    2014. To lend blur from where it is measured well to where it is not: Zhuo and Sim, Defocus map
    estimation from a single image, Pattern Recognition 2011.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES, synthesize
    >>> from dfdbench.datasets.captures import Capture
    >>> from dfdbench.datasets.manifest import Pair
    >>> image = np.random.default_rng(0).integers(0, 256, (60, 120, 3)).astype(np.uint8)
    >>> image = cv2.GaussianBlur(image, (0, 0), 3)
    >>> depth = np.repeat(np.array([[40, 120, 200]], np.uint8), 60, 0).repeat(40, 1)
    >>> defocus = synthesize(image, depth, RECIPES["published"])
    >>> pair = Capture(Pair("room", ()), np.stack([image, defocus]), depth.astype(np.float32))
    >>> method = WeightedLeastSquares()
    >>> method.restore(method.fit([pair]))
    >>> bool(np.abs(method(image, defocus)[30, 20::40] - [40, 120, 200]).max() < 10)
    True
    """

    #: What `dfdbench.tune` tries.
    ranges: ClassVar[dict[str, Sequence[float]]] = {"contrast": (1.0, 2.0, 3.0, 5.0, 10.0)}
    paper = "Min et al., Fast global image smoothing based on weighted least squares, TIP 2014"

    def __init__(self, contrast: float = 3.0) -> None:
        MethodError.raise_if(fitted.number_within("contrast", contrast, 255))
        self._contrast = float(contrast)
        #: What the fit chose.
        self.chosen = Choice()
        self._table: tuple[Array, Array] | None = None

    def fit(self, pairs: Sequence[TrainingPair]) -> Learned:
        """Learn how to measure and smooth, and the table of ``measure`` and ``depth``.

        Raises
        ------
        MethodError
            If no pair has a pixel of known depth, or pairs are not taken alike.
        """
        from dfdbench.methods.stacks import require_alike

        require_alike(pairs)
        trial = copy.copy(self)
        trial.chosen = self._best_on(pairs)
        return trial.chosen._asdict() | fitted.depth_table(trial.variance, pairs, _NAME)

    def restore(self, learned: Learned) -> None:
        """Take over what `fit` learned."""
        smoothing, window, strength = (
            float(fitted.learned_array(learned, name, _NAME, 0)) for name in Choice._fields
        )
        measure, depth = (
            fitted.learned_array(learned, name, _NAME, 1) for name in ("measure", "depth")
        )
        usable = 0 < smoothing <= 20 and 0 < window <= 255 and window % 2 == 1
        table = measure.shape == depth.shape and (np.diff(measure) >= 0).all()
        if not (usable and table and 0 <= strength <= _MOST):
            raise MethodError("not what this method learns", where=_NAME, fix=fitted.REFIT)
        self.chosen, self._table = Choice(smoothing, int(window), strength), (measure, depth)

    def warm_up(self, infocus: fitted.Image, defocus: fitted.Image) -> None:
        """Compile the code that the first call would compile."""
        self.variance(infocus[:32, :32].copy(), defocus[:32, :32].copy())

    def __call__(self, infocus: fitted.Image, defocus: fitted.Image) -> NDArray[np.float32]:
        """Return depth levels for two images of uint8, shape (y, x, 3) or, grey, (y, x)."""
        if self._table is None:
            raise fitted.not_fitted(_NAME)
        return np.asarray(np.interp(self.variance(infocus, defocus), *self._table), np.float32)

    def variance(self, infocus: fitted.Image, defocus: fitted.Image) -> NDArray[np.float64]:
        """Return what the blur adds to the variance along an axis, square pixels, shape (y, x)."""
        smoothing, window, strength = self.chosen
        # The fit chose it on larger images.
        window = min(window, max((min(infocus.shape[:2]) - 1) // 2 * 2 + 1, _MEASURES[0][1]))
        return self._smoothed(*measured(infocus, defocus, smoothing, window), infocus, strength)

    def _smoothed(
        self, variance: Array, weight: Array, infocus: fitted.Image, strength: float
    ) -> NDArray[np.float64]:
        if not strength:
            return variance
        by = weight, infocus, strength, self._contrast
        return np.asarray(lent_within_edges(variance[np.newaxis], *by)[0])

    def _best_on(self, pairs: Sequence[TrainingPair]) -> Choice:
        """Return the choice of least absolute error, each group's by a table of the others."""
        read = fitted.evenly_spread(len(pairs), _LOOKED_AT)
        named, parts = list[str](), list[Part]()
        # One capture at a time, as they may be large.
        for turn, index in enumerate(read):
            capture = pairs[index]
            named.append(str(getattr(capture, "group", "")))
            parts.append(cut_out(capture, turn, _SIDE))
        # A few small captures take no window from the others.
        sides = np.array([min(part.levels.shape) for part in parts])
        tried = [each for each in _MEASURES if each[1] <= np.median(sides)] or [_MEASURES[0]]
        large = sides >= min(tried[-1][1], np.median(sides))
        parts = [parts[place] for place in np.flatnonzero(large)]
        groups = groups_of(named, read, len(pairs))[large]
        known = [_some(part.valid) for part in parts]
        levels = [
            part.levels.ravel()[at].astype(np.float64)
            for part, at in zip(parts, known, strict=True)
        ]
        least, best = np.inf, self.chosen
        for smoothing, window in tried:
            found = [measured(part.infocus, part.defocus, smoothing, window) for part in parts]
            for strength in _STRENGTHS:

                def smooth(place: int, found: list[Any] = found, by: float = strength) -> Array:
                    variance, weight = found[place]
                    lent = self._smoothed(variance, weight, parts[place].infocus, by)
                    return lent.ravel()[known[place]]

                measures = in_threads(smooth, range(len(parts)))
                if (error := _error(measures, levels, groups)) < least:
                    least, best = error, Choice(smoothing, window, strength)
        return best


def measured(
    infocus: fitted.Image, defocus: fitted.Image, smoothing: float, window: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the variance that the blur adds, and how much texture says so; shape (y, x).

    The least squares of `STransform`, with the root of the mean squared Laplacian as the weight.

    Parameters
    ----------
    infocus, defocus : ndarray of uint8, shape (y, x, 3) or (y, x)
    smoothing : float
        Standard deviation of the Gaussian that both images are smoothed with first, in pixels.
    window : int
        Side of the square window, odd.
    """
    laplacian, difference = laplacian_and_difference(infocus, defocus, smoothing)
    along, square = (
        cv2.boxFilter(
            products.sum(2), cv2.CV_64F, (window, window), borderType=cv2.BORDER_REPLICATE
        )
        for products in (difference * laplacian, laplacian**2)
    )
    square = square + _NO_TEXTURE
    return np.asarray(2 * along / square), np.sqrt(square)


def _some(valid: NDArray[np.bool_]) -> NDArray[np.intp]:
    known = np.flatnonzero(valid)
    return known[fitted.evenly_spread(known.size, _PIXELS)]


def _error(measures: Sequence[Array], levels: Sequence[Array], groups: Array) -> float:
    """Return the mean over captures of the absolute error by a table of the other groups."""
    errors = []
    for group in sorted(set(groups)):
        captures = list(zip(groups == group, measures, levels, strict=True))
        others = [measure for own, measure, _ in captures if not own]
        table = fitted.table_of(others, [truth for own, _, truth in captures if not own])
        for own, measure, truth in captures:
            if own and truth.size and len(table[0]):
                errors.append(np.abs(np.interp(measure, *table) - truth).mean())
    return float(np.mean(errors)) if errors else np.inf
