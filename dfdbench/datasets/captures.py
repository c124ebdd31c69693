"""A capture: N images of one view, the facts known about each, and the depth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.captured_files import BY_IMAGE, OF_CAMERA
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Depth, Pair
from dfdbench.errors import InputError
from dfdbench.system.thumbnails import Thumbnail, depth_map, gallery, heading, photograph

if TYPE_CHECKING:
    import xarray

Role = Literal["infocus", "defocus"]
#: What an image may be; a store holds their numbers.
ROLES: tuple[Role, ...] = ("infocus", "defocus")
#: The roles of a pair's images.
PAIR: tuple[Role, ...] = ("infocus", "defocus")
#: How many images of a stack are shown as thumbnails.
_SHOWN = 4

#: What depth means by default: levels, brighter is nearer, 0 is unknown.
LEVELS = Depth(axes=[], unknown=0, grows_with="nearness", unit="levels")

Image = NDArray[np.uint8] | NDArray[np.uint16]


def _unknown() -> NDArray[np.float64]:
    return np.array(np.nan)


@dataclass(frozen=True)
class ImageFacts:
    """What is known of a capture's images and of the camera; NaN if unknown.

    Parameters
    ----------
    roles : tuple of str
        ``infocus`` or ``defocus``, one per image.
    focus_distance : ndarray of float64, shape (image,)
        Distance from the camera to the plane in focus, in metres.
    focus_depth : ndarray of float64, shape (image,)
        The same as a depth, in the unit of the truth.
    f_number : ndarray of float64, shape (image,)
        Focal length over aperture.
    focal_length, pixel_pitch : ndarray of float64, shape ()
        Of the camera, in metres.
    """

    roles: tuple[Role, ...] = PAIR
    focus_distance: NDArray[np.float64] = field(default_factory=_unknown)
    focus_depth: NDArray[np.float64] = field(default_factory=_unknown)
    f_number: NDArray[np.float64] = field(default_factory=_unknown)
    focal_length: NDArray[np.float64] = field(default_factory=_unknown)
    pixel_pitch: NDArray[np.float64] = field(default_factory=_unknown)


@dataclass(frozen=True, eq=False)
class Capture:
    """N images of one view and its depth; a pair is a capture of two.

    Parameters
    ----------
    pair : Pair
        Which capture it is.
    images : ndarray of uint8 or uint16, shape (image, y, x, channel)
        RGB.
    depth : ndarray of float32, shape (y, x)
        In the data set's unit; NaN where it is not known.
    facts : ImageFacts
        What is known of the images.
    about : Depth
        What the depth means: the manifest's section.
    group : str
        The family or room of its scene, or the scene itself; empty if unknown.

    Examples
    --------
    >>> grey = np.full((2, 4, 6, 3), 90, np.uint8)
    >>> capture = Capture(Pair("Desk", ()), grey, np.full((4, 6), 40, np.float32))
    >>> capture.infocus.shape, capture.stack.sizes["image"], int(capture.levels[0, 0])
    ((4, 6, 3), 2, 40)
    """

    pair: Pair
    images: Image
    depth: NDArray[np.float32]
    facts: ImageFacts = field(default_factory=ImageFacts)
    about: Depth = LEVELS
    group: str = ""

    def __repr__(self) -> str:
        count, height, width = self.images.shape[:3]
        return f"<{self.pair.id}: {count} images of {width} x {height}>"

    def __eq__(self, other: object) -> bool:
        """Return whether both are the same capture, with the same images and depth."""
        if not isinstance(other, Capture):
            return NotImplemented
        same = (self.pair, self.group) == (other.pair, other.group)
        same = same and np.array_equal(self.images, other.images)
        return same and np.array_equal(self.depth, other.depth, equal_nan=True)

    def __hash__(self) -> int:
        return hash((self.pair, self.group))

    @property
    def infocus(self) -> NDArray[np.uint8]:
        """The image in focus everywhere, shape (y, x, channel), 8 bits; the first of several."""
        return self._image("infocus")

    @property
    def defocus(self) -> NDArray[np.uint8]:
        """The blurred image, shape (y, x, channel), 8 bits; the first of several."""
        return self._image("defocus")

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True where the depth is known."""
        return np.isfinite(self.depth)

    @property
    def levels(self) -> NDArray[np.uint8]:
        """The depth as levels 0 to 255; the manifest's unknown level where it is not known."""
        return self.about.levels_of(self.depth)

    @property
    def truth(self) -> NDArray[Any]:
        """What protocols score: metres, or levels with the unknown level where truth is missing."""
        return self.about.scored(self.depth)

    @property
    def is_pair(self) -> bool:
        """Whether it has an in-focus and a defocus image, and no other."""
        return self.facts.roles == PAIR

    @property
    def stack(self) -> xarray.DataArray:
        """The images and their facts, dimensions (image, y, x, channel).

        The coordinates of ``image`` are ``role``, ``focus_distance`` (metres), ``focus_depth`` (in
        the unit of the truth) and ``f_number``. The attributes are ``unit``, ``near`` and ``far``
        (the ends of the set's depths, in that unit), ``focal_length`` and ``pixel_pitch`` (metres).
        NaN means unknown.
        """
        facts, count = self.facts, len(self.images)
        near, far = self.about.ends
        known = {name: np.broadcast_to(getattr(facts, name), count) for name in BY_IMAGE}
        import xarray  # a run of pairs does not need it

        return xarray.DataArray(
            self.images,
            dims=("image", "y", "x", "channel"),
            coords={"role": ("image", list(facts.roles))}
            | {name: ("image", values) for name, values in known.items()},
            attrs={"unit": self.about.kind, "near": near, "far": far}
            | {name: float(getattr(facts, name)) for name in OF_CAMERA},
        )

    @property
    def shown(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """The two images that figures show: the in-focus one, or else the first, and the next."""
        first = self.facts.roles.index("infocus") if "infocus" in self.facts.roles else 0
        second = (first + 1) % len(self.images)
        return eight_bits(self.images[first]), eight_bits(self.images[second])

    def two_of(self, images: Sequence[int] | None) -> Capture:
        """Return a pair of two of the images; the first becomes the in-focus one."""
        if images is None:
            return self
        for number in images:
            if not 0 <= number < len(self.images):
                what = f"image {number} is not there"
                raise InputError(what, where=self.pair.id, expected=f"0 to {len(self.images) - 1}")
        facts = {
            name: np.broadcast_to(getattr(self.facts, name), len(self.images))[list(images)]
            for name in BY_IMAGE
        }
        known = replace(self.facts, roles=PAIR, **facts)
        return replace(self, images=self.images[list(images)], facts=known)

    def _image(self, role: Role) -> NDArray[np.uint8]:
        if role not in self.facts.roles:
            fix = "take a method of stacks, or name the two images of a pair: images=FIRST,SECOND"
            raise InputError(f"the capture has no {role} image", where=self.pair.id, fix=fix)
        return eight_bits(self.images[self.facts.roles.index(role)])

    def _repr_html_(self) -> str:
        rows, columns = self.depth.shape
        known = 100 * float(self.valid.mean())
        facts = f"{columns} × {rows} pixels, depth known at {known:.1f} % of them"
        return heading(self.pair.id, facts) + gallery([self.thumbnails()])

    def thumbnails(self) -> list[Thumbnail]:
        """Return thumbnails of the ground truth and the images; of a stack only the first few."""
        images = [
            photograph(eight_bits(image), {"infocus": "in-focus"}.get(role, role))
            for image, role in zip(self.images, self.facts.roles, strict=True)
        ]
        return [*images[:_SHOWN], depth_map(self.levels, self.valid, "ground truth")]


def capture_of(stack: xarray.DataArray) -> Capture:
    """Return a stack as a capture without depth.

    Parameters
    ----------
    stack : DataArray of uint8 or uint16, dimensions (image, y, x, channel)
        Anything missing from its coordinates and attributes counts as unknown; images without a
        role are defocus images.

    Raises
    ------
    InputError
        If its dimensions or values are different.
    """
    if tuple(stack.dims) != ("image", "y", "x", "channel") or stack.sizes["channel"] != 3:
        got = ", ".join(f"{key} {size}" for key, size in stack.sizes.items())
        what = "not a stack of dimensions image, y, x, channel, with 3 channels"
        raise InputError(what, where="stack", got=got)
    if stack.dtype not in (np.uint8, np.uint16):
        got = str(stack.dtype)
        raise InputError("not a stack", where="stack", expected="uint8 or uint16", got=got)
    count = stack.sizes["image"]
    roles = stack["role"].values if "role" in stack.coords else ["defocus"] * count
    by_image = {key: stack[key].values.astype(float) for key in BY_IMAGE if key in stack.coords}
    facts = ImageFacts(
        tuple("infocus" if role == "infocus" else "defocus" for role in roles),
        **by_image,
        **{key: np.array(float(stack.attrs[key])) for key in OF_CAMERA if key in stack.attrs},
    )
    about = LEVELS
    if stack.attrs.get("unit") == "metres":
        near, far = (float(stack.attrs.get(end) or "nan") for end in ("near", "far"))
        if not 0 < near < far < math.inf:
            expected, got = "0 < near < far, in metres", f"near {near:g}, far {far:g}"
            raise InputError("a stack without ends of depth", expected=expected, got=got)
        scale = DepthScale(near=near, far=far)
        about = LEVELS.model_copy(update={"unit": "metres", "scale": scale})
        # In metres a distance is the depth.
        facts = replace(facts, focus_depth=by_image.get("focus_depth", facts.focus_distance))
    depth = np.full(stack.shape[1:3], np.nan, np.float32)
    return Capture(Pair("stack", ()), stack.values, depth, facts, about)


def eight_bits(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Convert an image of 8 or 16 bits to 8.

    Examples
    --------
    >>> eight_bits(np.array([0, 257, 65535], np.uint16)).tolist()
    [0, 1, 255]
    """
    return image if image.dtype == np.uint8 else np.rint(image / 257).astype(np.uint8)
