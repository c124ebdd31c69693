"""Shared by the classical methods: the blur they are told, or calibrate where nobody tells it.

The measuring itself is `calibration.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LEVELS, BlurRecipe
from dfdbench.errors import MethodError
from dfdbench.methods.fit import Learned, TrainingPair

if TYPE_CHECKING:
    from dfdbench.methods.calibration import Calibration


class Calibrated:
    """A method that has to know the blur: it is told, or measures it on training pairs.

    Parameters
    ----------
    recipe : BlurRecipe, BlurLaw or None
        The blur; None leaves it to the fit.
    """

    def __init__(self, recipe: BlurRecipe | BlurLaw | None) -> None:
        self._told = recipe
        #: What the fit measured; None where the blur was told, or before the fit.
        self.calibration: Calibration | None = None

    @property
    def fit(self) -> Callable[[Sequence[TrainingPair]], Learned] | None:
        """Measures the blur law of training pairs; None where the blur was told."""
        return self._fit if self._told is None else None

    def restore(self, learned: dict[str, Any]) -> None:
        """Take back what `fit` returned."""
        # Here and in the fit: it brings half of scipy, which nobody needs who was told the blur.
        from dfdbench.methods.calibration import Calibration

        self.calibration = Calibration.of(learned)

    @property
    def levels(self) -> int:
        """How many depth levels the blur tells apart."""
        return LEVELS if self._told is None else self._told.levels

    @property
    def blur(self) -> BlurRecipe | BlurLaw:
        """The blur that is solved with.

        Raises
        ------
        MethodError
            Where it was neither told nor measured.
        """
        if self._told is not None:
            return self._told
        if self.calibration is None:
            raise MethodError(
                "the method was not told the blur, and was not fitted",
                where=type(self).__name__,
                expected="a recipe, or fit(pairs) and restore(learned) before the first pair",
            )
        return self.calibration.law

    def _fit(self, pairs: Sequence[TrainingPair]) -> Learned:
        from dfdbench.methods.calibration import calibrate

        return calibrate(pairs).as_learned()
