"""A folder in ZEDD's layout, of made scenes: focal stacks at several apertures, depth in metres."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.made_folder import photograph

SHAPE = (48, 72)
APERTURES = ("1.4", "2.0", "2.8", "4.0", "5.6")
#: Focus distances in metres, by motor position; evenly spread in 1/z, the nearest is run_1.
MOTORS = {
    "2371" if run == 5 else f"{0x2000 + 0xDD * run:x}": round(1 / (1.3565 - 0.137 * run), 2)
    for run in range(1, 10)
}
_IN_FOCUS = "img_run_5_motor_2371_aperture_F16.0.jpg"


def floor() -> NDArray[np.float32]:
    """Return the depth of a floor from 6 m to 1 m, a column of it unknown."""
    rows = 1 / np.linspace(1 / 6, 1, SHAPE[0])[:, np.newaxis]
    depth = np.repeat(rows, SHAPE[1], axis=1).astype(np.float32)
    depth[:, 0] = np.nan
    return depth


def taken(seed: int, aperture: float, focus: float) -> NDArray[np.uint8]:
    """Return a photograph of the floor: each row is blurred by how far it is out of focus."""
    whole = photograph(seed, SHAPE)
    sigmas = 4 / aperture * np.abs(1 / floor()[:, 1] - 1 / focus)
    rows = [cv2.GaussianBlur(whole, (0, 0), float(sigma) + 0.01)[8:-8, 8:-8] for sigma in sigmas]
    return np.stack([image[row] for row, image in enumerate(rows)])


def make_zedd(folder: Path, scenes: int = 2, split: str = "val") -> Path:
    """Write the first scenes of a split below a folder, and return it; depth of ``val`` alone."""
    runs = enumerate(MOTORS.items(), 1)
    lines = [f"run_{run}\t{motor}\t{metres}" for run, (motor, metres) in runs]
    folder.mkdir(parents=True)
    (folder / "metadata.txt").write_text("\n".join(["# run, motor, focus (m)", *lines]) + "\n")
    for number in range(1, scenes + 1):
        scene = folder / f"{split}/{split}_{number:04}"
        (scene / "focus_stack").mkdir(parents=True)
        (scene / "gt").mkdir()
        if split == "val":
            np.save(scene / "gt/depth.npy", floor())
        np.savetxt(scene / "gt/K.txt", np.diag([60.0, 60.0, 1.0]))
        _write(scene / "focus_stack" / _IN_FOCUS, taken(number, 1e3, 2))
        for run, (motor, metres) in enumerate(MOTORS.items(), 1):
            for aperture in APERTURES:
                name = f"img_run_{run}_motor_{motor}_aperture_F{aperture}.jpg"
                _write(scene / "focus_stack" / name, taken(number, float(aperture), metres))
    return folder


def _write(path: Path, image: NDArray[np.uint8]) -> None:
    cv2.imwrite(str(path), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
