"""A measured blur law, and what it was measured from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw, law_of_fields
from dfdbench.methods.method import Learned
from dfdbench.methods.view_change import KNOTS, ViewChange

# The curve without fall-off.
_EVEN = [1.0] * KNOTS


@dataclass(frozen=True)
class Calibration:
    """A blur law, and what it was measured from.

    Parameters
    ----------
    law : BlurLaw
        The law.
    measured : ndarray of float64, shape (level,)
        The width that fits each depth level best by itself; NaN if no pixel counted.
    pixels : ndarray of int64, shape (level,)
        How many pixels counted at each level.
    residual : ndarray of float64, shape (level,)
        Root mean square, in grey levels, of what the law leaves unexplained; NaN without pixels.
    uneven : float
        How much the light differs from place to place, apart from fall-off: see `ViewChange`.
    """

    law: BlurLaw
    measured: NDArray[np.float64]
    pixels: NDArray[np.int64]
    residual: NDArray[np.float64]
    uneven: float = 0.0

    @property
    def change(self) -> ViewChange:
        """What the camera changes besides the blur."""
        return replace(ViewChange.of(self.law), uneven=self.uneven)

    def as_learned(self) -> Learned:
        """Return it in the form that a method's fit returns."""
        law = self.law.as_dict()
        return {
            **{name: np.array(value) for name, value in law.items()},
            "falloff": np.array(self.law.falloff or [_EVEN]),
            "measured": self.measured,
            "pixels": self.pixels,
            "residual": self.residual,
            "uneven": self.uneven,
        }

    @classmethod
    def all_as_learned(cls, found: Sequence[Calibration]) -> Learned:
        """Return a stack's calibrations, stacked; return a single one as `as_learned` does."""
        each = [calibration.as_learned() for calibration in found]
        if len(each) == 1:
            return each[0]
        # An image without fall-off needs as many curves as the others.
        rows = [np.shape(one["falloff"]) for one in each]
        each = [one | {"falloff": np.broadcast_to(one["falloff"], max(rows))} for one in each]
        return {name: np.stack([np.asarray(one[name]) for one in each]) for name in each[0]}

    @classmethod
    def all_of(cls, learned: Learned) -> tuple[Calibration, ...]:
        """Return the calibrations that `all_as_learned` was given."""
        if np.ndim(learned["sigmas"]) == 1:
            return (cls.of(learned),)
        names, columns = learned.keys(), map(np.asarray, learned.values())
        return tuple(
            cls.of(dict(zip(names, row, strict=True))) for row in zip(*columns, strict=True)
        )

    @classmethod
    def of(cls, learned: Learned) -> Calibration:
        """Return the calibration that `as_learned` was called on."""
        fields = dict(learned)
        measured, pixels, residual = (
            np.asarray(fields.pop(name)) for name in ("measured", "pixels", "residual")
        )
        uneven = float(fields.pop("uneven"))
        law = {name: np.asarray(value).tolist() for name, value in fields.items()}
        law["falloff"] = [curve for curve in law["falloff"] if curve != _EVEN]
        return cls(law_of_fields(law), measured, pixels, residual, uneven)
