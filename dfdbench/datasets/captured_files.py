"""Where the files of a captured set lie, what they hold, and how a pair is made of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from dfdbench.datasets.depth_scale import Positive
from dfdbench.system.strict import StrictRecord

#: What a pattern ends in if the files end differently.
ANY_ENDING = ".*"
_PLACE = re.compile(r"\{([^{}]*)\}")
#: What the files of a pair are.
ROLES = ("infocus", "defocus", "depth")

Index = Annotated[int, Field(ge=0)]
Extent = Annotated[int, Field(ge=1)]


class Crop(StrictRecord):
    """The part of each image that is kept, in pixels from its top left corner."""

    x: Index
    y: Index
    width: Extent
    height: Extent


class CapturedFiles(StrictRecord):
    """The files of a captured set, for the reader ``folder``.

    Parameters
    ----------
    infocus, defocus, depth : str
        Paths below the folder that is named when the set is built: PNG, JPEG or TIFF, and for
        depth also npy. ``{scene}`` stands for the scene's name, the name of an axis in braces for
        the pair's value on it, any other for what the scene gives under `names`. A pattern that
        ends in ``.*`` finds images with any ending, such as ``.JPG`` beside ``.png``.
    inside : str, optional
        A folder that the patterns lead on from where the named folder has it, such as the place of
        the set in a clone of its repository.
    depth_unit : float, optional
        How many metres one unit of a depth file is; left out, the files hold levels 0 to 255.
    depth_missing : list of float
        Values of pixels whose depth is not known; what is not finite never is.
    image_bits : int, optional
        How many bits of a 16-bit image are used; 16 unless the image says otherwise.
    exif_rotation : {"apply", "ignore"}, optional
        What to do where an image's EXIF data say that it is to be turned; left out, such a scene
        is refused.
    crop : Crop, optional
        Kept of each image once it is aligned; all of it by default.
    align : {"none", "translation", "euclidean"}
        By which motion one image is laid on the other (ECC).
    moved : {"defocus", "infocus"}
        Which image is moved; the depth map lies on the other.
    match_gain : bool
        Whether the defocus image gets the in-focus image's brightness.
    """

    infocus: str
    defocus: str
    depth: str
    inside: str | None = None
    depth_unit: Positive | None = None
    depth_missing: list[float] = Field(default=[0])
    image_bits: Annotated[int, Field(ge=9, le=16)] | None = None
    exif_rotation: Literal["apply", "ignore"] | None = None
    crop: Crop | None = None
    align: Literal["none", "translation", "euclidean"] = "none"
    moved: Literal["defocus", "infocus"] = "defocus"
    match_gain: bool = False

    def pattern_of(self, role: str) -> str:
        """Return the pattern of the in-focus image, the defocus image or the depth map."""
        return {"infocus": self.infocus, "defocus": self.defocus, "depth": self.depth}[role]


def places_in(pattern: str) -> tuple[str, ...]:
    """Return what stands in braces in a pattern.

    Examples
    --------
    >>> places_in("{scene}/f{f_number}.png")
    ('scene', 'f_number')
    """
    return tuple(_PLACE.findall(pattern))


def fill(pattern: str, values: Mapping[str, str]) -> str:
    """Return a pattern with what stands in braces replaced.

    Examples
    --------
    >>> fill("{scene}/f{f_number}.png", {"scene": "desk", "f_number": "2"})
    'desk/f2.png'
    """
    return _PLACE.sub(lambda match: values[match[1]], pattern)
