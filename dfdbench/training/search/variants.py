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
    crop_late : bool
        The size of patches starts at its largest velocity and moves by that of the iteration
        before.
    whole : bool
        Positions start at whole numbers, each equally likely, and are rounded after every move.
    against_previous : bool
        A particle's own best is replaced if the value is below that of the iteration before.
    begins_with_published : bool
        The first particle begins as DfD-Net itself, else somewhere as the others do.
    scores_centre : bool
        The objective looks at the centre of 368 x 400 pixels and divides by 255, else at whole
        images, by the protocol ``thesis``.
    """

    kernel_speed: float
    crop_wraps: bool
    crop_late: bool
    whole: bool
    against_previous: bool
    begins_with_published: bool
    scores_centre: bool


VARIANTS = {
    "thesis": Variant(
        kernel_speed=2,
        crop_wraps=False,
        crop_late=False,
        whole=False,
        against_previous=False,
        begins_with_published=False,
        scores_centre=False,
    ),
    "author": Variant(
        kernel_speed=1,
        crop_wraps=True,
        crop_late=True,
        whole=True,
        against_previous=True,
        begins_with_published=True,
        scores_centre=True,
    ),
}
