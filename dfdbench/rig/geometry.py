"""The capture rig's geometry (thesis, 3.2.1 to 3.2.3): a camera, and a LIDAR 93 mm above it.

Axes are the camera's: x to the right, y downwards, z ahead, in metres.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dfdbench.rig.lidar import UPSAMPLING, Beams, Floats


@dataclass(frozen=True)
class CaptureRig:
    """A camera and a LIDAR on one mount.

    Parameters
    ----------
    focal_length : float
        In pixels: 9.6 mm over 4.8 µm.
    frame_size : tuple of int
        Height and width of a captured frame; the optical axis meets its middle (Table 3.3).
    crop_size : int
        Side of the square that is kept from the frame's middle.
    baseline : float
        The LIDAR's height above the camera, in metres.
    """

    focal_length: float = 2000.0
    frame_size: tuple[int, int] = (728, 736)
    crop_size: int = 630
    baseline: float = 0.093

    @property
    def crop_offset(self) -> tuple[int, int]:
        """The crop's first row and column in a frame: y, x."""
        height, width = self.frame_size
        return (height - self.crop_size) // 2, (width - self.crop_size) // 2

    def crop(self, frame: NDArray[np.generic]) -> NDArray[np.generic]:
        """Return the middle of a frame, `crop_size` high and wide."""
        y, x = self.crop_offset
        return frame[y : y + self.crop_size, x : x + self.crop_size]

    def project(self, points: Floats) -> Floats:
        """Project points (..., 3) ahead of the camera, in metres, to a frame: (x, y).

        Examples
        --------
        >>> CaptureRig().project(np.array([0.15, 0.0, 1.5])).tolist()
        [567.5, 363.5]
        """
        height, width = self.frame_size
        middle: Floats = np.array([(width - 1) / 2, (height - 1) / 2])
        return np.asarray(self.focal_length * points[..., :2] / points[..., 2:] + middle)


@dataclass(frozen=True)
class Pose:
    """The LIDAR's rotation relative to the camera, in degrees; all 0 if they are parallel.

    Parameters
    ----------
    yaw, pitch, roll : float
        About the axes y, x and z of the camera.
    """

    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0

    def to_camera(self, points: Floats, rig: CaptureRig) -> Floats:
        """Transform points from the LIDAR's space to the camera's, shape (..., 3)."""
        return np.asarray(self.turn(points) + np.array([0.0, -rig.baseline, 0.0]))

    def turn(self, directions: Floats) -> Floats:
        """Rotate directions from the LIDAR's space to the camera's, shape (..., 3)."""
        turn = Rotation.from_euler("yxz", [self.yaw, self.pitch, self.roll], degrees=True)
        flat = turn.apply(directions.reshape(-1, 3))
        return np.asarray(flat).reshape(directions.shape)


def beam_directions(beams: Beams, columns: NDArray[np.int64], turn: int = 2048) -> Floats:
    """Return each beam's direction at each measurement, as unit vectors in the LIDAR's space.

    Parameters
    ----------
    beams : Beams
        The calibration; its angles are used, not the rounded indices.
    columns : ndarray of int, shape (column,)
        Measurement IDs.
    turn : int
        Columns in a full turn.

    Returns
    -------
    ndarray of float, shape (beam, column, 3)
        x to the right, y downwards, z ahead.
    """
    across = 2 * np.pi * ((columns - (turn - 1) / 2) / turn + beams.azimuth[:, np.newaxis] / 360)
    up = np.deg2rad(beams.altitude)[:, np.newaxis]
    return np.stack(
        [np.sin(across) * np.cos(up), -np.sin(up) + 0 * across, np.cos(across) * np.cos(up)],
        axis=-1,
    )


def depth_image_places(rows: int, columns: int) -> Floats:
    """Return where each cell of the cropped scan is in `dfdbench.rig.lidar.depth_image`.

    This is the middle of the block that a cell is scaled up to, in pixels (x, y), shape (row,
    column, 2).
    """
    down, across = UPSAMPLING[-1]
    x = (np.arange(columns) + 0.5) * across - 0.5
    y = (np.arange(rows) + 0.5) * down - 0.5
    return np.stack(np.meshgrid(x, y), axis=-1)
