"""Where a captured set's files are, what they hold, and how captures are made of them."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from dfdbench.system.strict import STEPS, Positive, Share, StrictRecord

#: The end of a pattern if the files' endings differ.
ANY_ENDING = ".*"
_PLACE = re.compile(r"\{([^{}]*)\}")
#: Facts per image; NaN if unknown.
BY_IMAGE = ("focus_distance", "focus_depth", "f_number")
#: Facts about the camera.
OF_CAMERA = ("focal_length", "pixel_pitch")
#: The placeholder for an image's number in the pattern of a stack.
IMAGE = "image"

#: The motion that aligns one image with another.
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

    If the manifest names a blur recipe, `infocus` and `depth` are all there is.

    Patterns are paths below the folder that is named when the set is built. ``{scene}`` stands for
    the scene's name, an axis name in braces for the capture's value on that axis, and any other
    name for what the scene gives under `names`. In `images` and the facts it may also be a column
    of the table. A pattern that ends in ``.*`` finds images with any ending, such as ``.JPG``
    beside ``.png``.

    Parameters
    ----------
    infocus, defocus : str, optional
        The patterns of a pair's photographs: PNG, JPEG or TIFF. A stack may also have `infocus`.
    images : str, optional
        The pattern of a stack's photographs, in place of `defocus`. It finds the images that differ
        only in the number at ``{image}``, in their names or in those of their folders.
    depth : str, optional
        The pattern of the depth map: an image, npy, npz or pfm. Without it the set has no truth.
    metadata : str, optional
        The pattern of a table with a row per image: text, or JSON with lists or records.
    columns : list of str
        The names of its columns, if it has no heading.
    image : list of dict
        The table itself, if there is no file.
    focus_distance, focus_depth, f_number : str or float, optional
        Of the defocus images: a number, or a pattern that becomes one; by default the table's
        column of that name. Focus depths are in the depth file's own unit.
    focus_unit : float or "dioptres"
        How many metres one unit of a focus distance is, or that it is 1 / metres.
    axis_names : dict
        What the files call each value of an axis, by axis and value.
    inside : str, optional
        A subfolder of the named folder in which patterns begin, if it exists: such as the set's
        place in a clone of its repository.
    depth_unit : float, optional
        How many metres one unit of a depth file is. Without it, the files hold levels 0 to 255, or
        metres if the set is in metres.
    depth_ends : list of float, optional
        The file's values at the nearest and the farthest level, for files in another unit, such as
        disparity. Levels are linear in these values.
    depth_missing : list of float
        Values of pixels whose depth is not known. Values that are not finite always count as
        unknown.
    image_bits : int, optional
        How many bits of a 16-bit image are used; 16 unless the image says otherwise.
    exif_rotation : {"apply", "ignore"}, optional
        What to do if an image's EXIF data say that it must be turned. Without it, such a scene is
        refused.
    crop : Crop, optional
        The part of each image that is kept after alignment; all of it by default.
    align : {"none", "translation", "euclidean", "similarity"}
        The motion that aligns each image with the first (ECC); the last also undoes magnification.
    moved : {"defocus", "infocus"}
        Which image of a pair is moved; the depth map is aligned with the other.
    match_gain : bool
        Whether the other images are brought to the first one's brightness.
    flat_field : list of list of float
        Of a pair: for red, green and blue, the light that reaches the defocus image, as a share of
        the in-focus image's, at even steps of r^2 from the middle to the corners. The defocus image
        is divided by it. Left out, nothing is divided.
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
    focus_unit: Positive | Literal["dioptres"] = 1.0
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

    @property
    def of_pairs(self) -> bool:
        """Whether captures are pairs: by two patterns, or by one and both roles."""
        roles = [row.get("role") for row in self.image]
        both = len(roles) == 2 and {*roles} == {"infocus", "defocus"}
        return self.images is None or (both and self.infocus is None)

    def values_of(
        self, scene: str, names: Mapping[str, str], axes: Mapping[str, int]
    ) -> dict[str, str]:
        """Return the values for a capture's patterns: its scene, its axes, the scene's names."""
        places = {
            axis: self.axis_names.get(axis, {}).get(str(v), str(v)) for axis, v in axes.items()
        }
        return {**names, "scene": scene, **places}

    def folder_in(self, folder: Path) -> Path:
        """Return the folder in which patterns begin: `inside` if it exists."""
        below = folder / (self.inside or "")
        return below if below.is_dir() else folder

    @property
    def table_columns(self) -> set[str] | None:
        """The names of the table's columns; None if only its file knows them."""
        if self.metadata is not None and not self.columns:
            return None
        return {*self.columns, *(name for row in self.image for name in row)}


def places_in(pattern: str) -> tuple[str, ...]:
    """Return the names in braces in a pattern.

    Examples
    --------
    >>> places_in("{scene}/f{aperture}.png")
    ('scene', 'aperture')
    """
    return tuple(_PLACE.findall(pattern))


def fill(pattern: str, values: Mapping[str, str]) -> str:
    """Return a pattern with the known names replaced; the others stay in braces.

    Examples
    --------
    >>> fill("{scene}/focus_{image}.png", {"scene": "desk"})
    'desk/focus_{image}.png'
    """
    return _PLACE.sub(lambda match: values.get(match[1], match[0]), pattern)
