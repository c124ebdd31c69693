"""Where the thesis's text and its author's programs search differently."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Variant:
    """What text and programs have differently.

    Parameters
    ----------
    kernel_speed : float
        The fastest that a filter's rows and columns change, in halves of their size.
    crop_wraps : bool
        The size of patches goes round at its limits, else it stops there.
    whole : bool
        Positions are rounded after every move.
    begins_with_published : bool
        The first particle begins as DfD-Net itself, else somewhere as the others do.
    scores_centre : bool
        The objective looks at the centre of 368 x 400 pixels and divides by 255, else at whole
        images, by the protocol ``thesis``.
    """

    kernel_speed: float
    crop_wraps: bool
    whole: bool
    begins_with_published: bool
    scores_centre: bool


VARIANTS = {
    "thesis": Variant(2, False, False, False, False),
    "author": Variant(1, True, True, True, True),
}
