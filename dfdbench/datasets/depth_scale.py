"""What depth levels are in metres, and the lens and camera of a captured set."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from dfdbench.system.strict import Positive, StrictRecord

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Level = Annotated[int, Field(ge=0, le=255)]


class DepthScale(StrictRecord):
    """How depth levels are converted to metres, and metres to levels.

    Reading a manifest needs no numpy, so numpy is imported only where it is used.

    Parameters
    ----------
    law : {"inverse", "linear"}
        Levels are linear in 1/z, as defocus blur is (the default), or in z.
    near, far : float
        The distances at both ends, in metres.
    near_level, far_level : int
        Their levels: 255 and 1 if brighter is nearer and level 0 is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> scale = DepthScale(law="inverse", near=0.5, far=5.0)
    >>> scale.to_levels(np.array([0.5, 1.0, 5.0, np.nan])).tolist()
    [255, 114, 1, 0]
    >>> scale.to_metres(np.array([255, 114, 1])).round(3).tolist()
    [0.5, 0.999, 5.0]
    """

    law: Literal["inverse", "linear"] = "inverse"
    near: Positive
    far: Positive
    near_level: Level = 255
    far_level: Level = 1

    def to_metres(self, levels: NDArray[Any]) -> NDArray[np.float64]:
        """Return the distance of each level, in metres.

        Parameters
        ----------
        levels : ndarray of any shape, integer or real
            Depth levels; levels beyond the two ends count as the end. They do not say which pixels
            are unknown: that is up to a mask.
        """
        import numpy as np

        near, far = self._ends
        share = (np.asarray(levels, np.float64) - self.far_level) / (
            self.near_level - self.far_level
        )
        place = far + np.clip(share, 0, 1) * (near - far)
        return 1 / place if self.law == "inverse" else place

    def to_levels(self, metres: NDArray[Any], unknown: int = 0) -> NDArray[np.uint8]:
        """Return the level nearest to each distance.

        Parameters
        ----------
        metres : ndarray of any shape
            Distances; those beyond near and far count as the end.
        unknown : int
            The level of invalid distances: not finite, zero or negative.
        """
        import numpy as np

        distances = np.asarray(metres, np.float64)
        known = np.isfinite(distances) & (distances > 0)
        held = np.where(known, distances, self.near).clip(self.near, self.far)
        return np.where(known, np.rint(self.to_exact_levels(held)), unknown).astype(np.uint8)

    def to_exact_levels(self, metres: NDArray[Any]) -> NDArray[np.float64]:
        """Return the level of each distance, without rounding.

        Parameters
        ----------
        metres : ndarray of any shape
            Distances above 0. Those beyond near and far have levels beyond theirs: a lens may be
            focused there.
        """
        import numpy as np

        near, far = self._ends
        distances = np.asarray(metres, np.float64)
        share = ((1 / distances if self.law == "inverse" else distances) - far) / (near - far)
        return np.asarray(self.far_level + share * (self.near_level - self.far_level))

    @property
    def _ends(self) -> tuple[float, float]:
        return (1 / self.near, 1 / self.far) if self.law == "inverse" else (self.near, self.far)


class Rig(StrictRecord):
    """The lens and camera that took a set's images; None if unknown.

    Parameters
    ----------
    focal_length : float, optional
        In metres.
    infocus_f_number, defocus_f_number : float, optional
        Focal length over aperture of the two images.
    pixel_pitch : float, optional
        Width of a pixel of the built images on the sensor, in metres.
    focus_distance : float, optional
        The distance at which the lens is focused, in metres.
    near, far : float, optional
        The nearest and the farthest distance in the scenes, in metres.
    """

    focal_length: Positive | None = None
    infocus_f_number: Positive | None = None
    defocus_f_number: Positive | None = None
    pixel_pitch: Positive | None = None
    focus_distance: Positive | None = None
    near: Positive | None = None
    far: Positive | None = None
