"""Where the files of a captured set lie, what they hold, and how captures are made of them."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from dfdbench.system.strict import STEPS, Positive, Share, StrictRecord

#: What a pattern ends in if the files end differently.
ANY_ENDING = ".*"
_PLACE = re.compile(r"\{([^{}]*)\}")
#: What is known of each image; NaN if it is not.
BY_IMAGE = ("focus_distance", "focus_depth", "f_number")
#: What is known of the camera.
OF_CAMERA = ("focal_length", "pixel_pitch")
#: What stands for an image's number in the pattern of a stack.
IMAGE = "image"

#: By which motion an image is laid on another.
Align = Literal["none", "translation", "euclidean", "similarity"]
Index = Annotated[int, Field(ge=0)]
Extent = Annotated[int, Field(ge=1)]


class Crop(StrictRecord):
    """The part of each image that is kept, in pixels from its top left corner."""

    x: Index
    y: Index
    width: Extent
    height: Extent


class CapturedFiles(StrictRecord):
    """The files of a captured set, for the reader ``folder``: of pairs or of stacks.

    Patterns are paths below the folder that is named when the set is built. ``{scene}`` stands for
    the scene's name, the name of an axis in braces for the capture's value on it, any other for
    what the scene gives under `names`; in `images` and the facts also for a column of the table. A
    pattern that ends in ``.*`` finds images with any ending, such as ``.JPG`` beside ``.png``.

    Parameters
    ----------
    infocus, defocus : str, optional
        The patterns of a pair's photographs: PNG, JPEG or TIFF. A stack may have `infocus`, too.
    images : str, optional
        The pattern of a stack's photographs, in place of `defocus`. ``{image}`` finds those that
        differ in this number alone.
    depth : str, optional
        The pattern of the depth map: an image, npy, npz or pfm. Left out, the set has no truth.
    metadata : str, optional
        The pattern of a table with a row per image: text, or JSON with lists or records.
    columns : list of str
        What its columns are called, if it has no heading.
    image : list of dict
        The table itself, if there is no file.
    focus_distance, focus_depth, f_number : str or float, optional
        Of the defocus images: a number, or a pattern that becomes one; the table's column of that
        name by default. Focus distances are in metres, focus depths in the depth file's own unit.
    axis_names : dict
        What files call an axis's values, by axis and value.
    inside : str, optional
        A folder that the patterns lead on from where the named folder has it, such as the place of
        the set in a clone of its repository.
    depth_unit : float, optional
        How many metres one unit of a depth file is; left out, the files hold levels 0 to 255, or
        metres if the set is in metres.
    depth_ends : list of float, optional
        The file's values at the nearest and the farthest level, for files in another unit, such as
        disparity: levels are linear in them.
    depth_missing : list of float
        Values of pixels whose depth is not known; what is not finite never is.
    image_bits : int, optional
        How many bits of a 16-bit image are used; 16 unless the image says otherwise.
    exif_rotation : {"apply", "ignore"}, optional
        What to do where an image's EXIF data say that it is to be turned; left out, such a scene
        is refused.
    crop : Crop, optional
        Kept of each image once it is aligned; all of it by default.
    align : {"none", "translation", "euclidean", "similarity"}
        By which motion each image is laid on the first (ECC); the last also undoes magnification.
    moved : {"defocus", "infocus"}
        Which image of a pair is moved; the depth map lies on the other.
    match_gain : bool
        Whether the other images get the first one's brightness.
    flat_field : list of list of float
        Of a pair: for red, green and blue, the light that reaches the defocus image, as a part of
        the in-focus image's, at even steps of r^2 from the middle to the corners. It is divided by
        that. Left out, nothing is.
    """

    infocus: str | None = None
    defocus: str | None = None
    images: str | None = None
    depth: str | None = None
    metadata: str | None = None
    columns: list[str] = Field(default_factory=list)
    image: list[dict[str, str | int | float]] = Field(default_factory=list)
    focus_distance: str | int | float | None = None
    focus_depth: str | int | float | None = None
    f_number: str | int | float | None = None
    axis_names: dict[str, dict[str, str]] = Field(default_factory=dict)
    inside: str | None = None
    depth_unit: Positive | None = None
    depth_ends: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    depth_missing: list[float] = Field(default=[0])
    image_bits: Annotated[int, Field(ge=9, le=16)] | None = None
    exif_rotation: Literal["apply", "ignore"] | None = None
    crop: Crop | None = None
    align: Align = "none"
    moved: Literal["defocus", "infocus"] = "defocus"
    match_gain: bool = False
    flat_field: list[Annotated[list[Share], STEPS]] | None = None

    @property
    def patterns(self) -> dict[str, str]:
        """The patterns of images, depth and table, by the field's name; those that are there."""
        named = ("infocus", "defocus", "images", "depth", "metadata")
        return {name: pattern for name in named if (pattern := getattr(self, name)) is not None}

    def values_of(
        self, scene: str, names: Mapping[str, str], axes: Mapping[str, int]
    ) -> dict[str, str]:
        """Return what stands in a capture's patterns: its scene, its axes, the scene's names."""
        places = {
            axis: self.axis_names.get(axis, {}).get(str(v), str(v)) for axis, v in axes.items()
        }
        return {**names, "scene": scene, **places}

    def folder_in(self, folder: Path) -> Path:
        """Return the folder that patterns begin in: `inside` where that is there."""
        below = folder / (self.inside or "")
        return below if below.is_dir() else folder

    @property
    def table_columns(self) -> set[str] | None:
        """The names that the table gives; None if only its file tells."""
        if self.metadata is not None and not self.columns:
            return None
        return {*self.columns, *(name for row in self.image for name in row)}


def places_in(pattern: str) -> tuple[str, ...]:
    """Return what stands in braces in a pattern.

    Examples
    --------
    >>> places_in("{scene}/f{aperture}.png")
    ('scene', 'aperture')
    """
    return tuple(_PLACE.findall(pattern))


def fill(pattern: str, values: Mapping[str, str]) -> str:
    """Return a pattern with what is known replaced, and the rest left in its braces.

    Examples
    --------
    >>> fill("{scene}/focus_{image}.png", {"scene": "desk"})
    'desk/focus_{image}.png'
    """
    return _PLACE.sub(lambda match: values.get(match[1], match[0]), pattern)
