"""The S-transform: how much the blur's variance grew, from a Laplacian and a difference."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import MethodError
from dfdbench.methods import fitted
from dfdbench.methods.method import Learned, TrainingPair
from dfdbench.methods.spread import Sureness

_NAME = "s-transform"
# In squared grey levels a square pixel and window: where the Laplacian has less, there is no
# texture, and the variance is taken for the middle one.
_NO_TEXTURE = 1e-3
_MIDDLE_VARIANCE = 3.0


class STransform:
    """Depth from the variance that the blur adds, in closed form.

    If an image is a cubic polynomial, a blur of variance v along each axis adds v / 2 times
    its Laplacian, whatever the blur's shape. So the difference of the two images gives v: the
    least squares over a window of ``defocus - infocus = v / 2 * laplacian``, with the Laplacian of
    both images' mean.

    Parameters
    ----------
    recipe : BlurRecipe or BlurLaw, optional
        How the defocus images were made: its variances give the depth. Without it the method is
        fitted: a table of v and depth from training pairs, as the paper calibrates its lens.
    smoothing : float
        Standard deviation in pixels of the Gaussian that both images are smoothed with first,
        so that they come near to polynomials.
    window : int
        Side of the square window in pixels, odd.
    sure : bool
        Also say how sure it is, in levels: the standard error of the least squares, times the
        factor with which its intervals hold on training captures. So it is fitted even with a
        recipe.

    Raises
    ------
    MethodError
        For a parameter out of range, all of them named; for a law that turns; at a call without
        recipe or fit, or with an image
        smaller than the window.

    Notes
    -----
    In the paper the variance is that of both axes together, 2 v. It smooths with a polynomial fit;
    here a Gaussian does. It takes the root of a quotient of sums of squares; least squares also
    tell its sign, and noise of the difference does not add to it.

    Examples
    --------
    >>> from dfdbench.blur import RECIPES, synthesize
    >>> image = np.random.default_rng(0).integers(0, 256, (60, 60, 3)).astype(np.uint8)
    >>> image = cv2.GaussianBlur(image, (0, 0), 3)
    >>> defocus = synthesize(image, np.full((60, 60), 120, np.uint8), RECIPES["published"])
    >>> found = STransform(RECIPES["published"])(image, defocus)
    >>> bool(abs(np.median(found) - 120) < 10)
    True
    """

    #: What `dfdbench.tune` tries.
    ranges: ClassVar[dict[str, Sequence[float]]] = {
        "smoothing": (0.5, 1.0, 2.5, 4.0),
        "window": (9, 21, 41, 61, 91, 131),
    }
    paper = "Subbarao and Surya, Depth from defocus: a spatial domain approach, IJCV 1994"

    def __init__(
        self,
        recipe: fitted.Blur | None = None,
        smoothing: float = 2.5,
        window: int = 9,
        sure: bool = False,
    ) -> None:
        problems = fitted.number_within("smoothing", smoothing, 20)
        problems += fitted.odd_window("window", window)
        problems += [] if isinstance(sure, bool) else [fitted.wrong("sure", "true or false", sure)]
        MethodError.raise_if(problems)
        self._sure = Sureness(sure, _NAME)
        self._recipe = recipe
        self._smoothing = float(smoothing)
        self._window = (window, window)
        self._variances: NDArray[np.float64] | None = None
        if recipe is not None:
            variances = np.square(recipe.sigmas)
            rises = np.diff(variances)
            if rises.min() < 0 < rises.max():
                what = "the blur neither rises nor falls with depth: the focus is inside the scene"
                fix = "another method, or a fit to captures (run --param recipe=null)"
                raise MethodError(what, where=_NAME, fix=f"take {fix}")
            levels = np.argsort(variances, kind="stable")
            self._variances = variances[levels]
            self._depths = recipe.depth_of_level(levels)

    @property
    def fit(self) -> fitted.Fit | None:
        """Learns the table of variance and depth if no recipe gives it, and how sure to be."""
        return self._learn if self._recipe is None or self._sure.asked else None

    def _learn(self, pairs: Sequence[TrainingPair]) -> Learned:
        from dfdbench.methods.stacks import require_alike

        require_alike(pairs)
        table = {} if self._recipe is not None else fitted.depth_table(self.variance, pairs, _NAME)
        if not self._sure.asked:
            return table
        trial = copy.copy(self)
        trial.restore(table)

        def answer(pair: TrainingPair) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
            return trial._depth(pair.infocus, pair.defocus)

        return table | self._sure.learned_on(answer, pairs)

    def restore(self, learned: Learned) -> None:
        """Take over what `fit` learned."""
        learned = dict(learned)
        self._sure = self._sure.restored(learned)
        if self._recipe is not None:
            return
        self._variances = fitted.learned_array(learned, "measure", _NAME, 1)
        self._depths = fitted.learned_array(learned, "depth", _NAME, 1)

    def __call__(self, infocus: fitted.Image, defocus: fitted.Image) -> fitted.Answer:
        """Return depth levels for two images of uint8, shape (y, x, 3) or, grey, (y, x).

        And where it says how sure it is, sigma.
        """
        return self._sure.answer(*self._depth(infocus, defocus))

    def _depth(
        self, infocus: fitted.Image, defocus: fitted.Image
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return depth levels, and the standard error of the variance that they come from."""
        if self._variances is None:
            raise fitted.not_fitted(_NAME)
        fitted.require_window_fits(self._window[0], infocus, _NAME)
        variance, error = self._measured(infocus, defocus)
        depth = np.interp(variance, self._variances, self._depths)
        return np.asarray(depth, np.float32), error

    def variance(self, infocus: fitted.Image, defocus: fitted.Image) -> NDArray[np.float32]:
        """Return what the blur adds to the variance along an axis, square pixels, shape (y, x)."""
        return self._measured(infocus, defocus)[0]

    def _measured(
        self, infocus: fitted.Image, defocus: fitted.Image
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the variance that the blur adds, and its standard error but for a factor.

        Of ``difference = v / 2 * laplacian``: ``2 sqrt(rest / sum(laplacian^2))``, where rest is
        what the least squares leave of ``sum(difference^2)``.
        """
        laplacian, difference = laplacian_and_difference(infocus, defocus, self._smoothing)
        along, square, whole = (
            cv2.boxFilter(
                products.sum(2), cv2.CV_32F, self._window, borderType=cv2.BORDER_REPLICATE
            )
            for products in (difference * laplacian, laplacian**2, difference**2)
        )
        usual = _NO_TEXTURE * _MIDDLE_VARIANCE
        variance = (2 * along + usual) / (square + _NO_TEXTURE)
        rest = np.maximum(whole - along**2 / (square + _NO_TEXTURE), 0) + _NO_TEXTURE
        error = 2 * np.sqrt(rest / (square + _NO_TEXTURE))
        return np.asarray(variance, np.float32), np.asarray(error, np.float32)


def laplacian_and_difference(
    infocus: fitted.Image, defocus: fitted.Image, smoothing: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the smoothed images' mean Laplacian and how they differ, shape (y, x, channel)."""
    edge = cv2.BORDER_REPLICATE
    sharp, blurred = (
        np.atleast_3d(
            cv2.GaussianBlur(fitted.channels_of(image), (0, 0), smoothing, borderType=edge)
        )
        for image in (infocus, defocus)
    )
    laplacian = np.atleast_3d(cv2.Laplacian((sharp + blurred) / 2, cv2.CV_32F, borderType=edge))
    return np.asarray(laplacian, np.float32), np.asarray(blurred - sharp, np.float32)
