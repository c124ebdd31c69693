"""Focal stacks in a folder: four scenes, an image in focus and three that are focused somewhere."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.made_folder import FOLDER_TOML, SCENES, depth_in_millimetres, photograph

#: Focus distances in metres, by the number of the image.
FOCUS = {1: 1, 2: 2, 3: 4}
_START, _END = FOLDER_TOML.index("[files]"), FOLDER_TOML.index("[table]")
STACK_TOML = (
    FOLDER_TOML[:_START].replace("linear in 1/z from 0.5 m to 5 m", "metres")
    + """\
[files]
infocus = "{scene}/sharp.png"
images = "{scene}/f_{image}.png"
metadata = "{scene}/focus.csv"
depth = "{scene}/depth.npy"

[rig]
focal_length = 0.05

"""
    + FOLDER_TOML[_END:]
)


def make_stacks(folder: Path) -> Path:
    """Write all scenes below a folder and return it."""
    for seed, scene in enumerate(SCENES):
        (folder / scene).mkdir(parents=True)
        whole = photograph(seed)
        depth = depth_in_millimetres().astype(np.float32) / 1000
        depth[depth == 0] = np.nan
        np.save(folder / scene / "depth.npy", depth)
        write_image(folder / scene / "sharp.png", whole[8:-8, 8:-8, ::-1])
        for number in FOCUS:
            blurred = cv2.GaussianBlur(whole, (0, 0), 0.5 * number)[8:-8, 8:-8]
            write_image(folder / scene / f"f_{number:03}.png", blurred[..., ::-1])
        rows = [f"{number},{metres}" for number, metres in FOCUS.items()]
        (folder / scene / "focus.csv").write_text("\n".join(("image,focus_distance", *rows)))
    return folder


def write_image(path: Path, image: NDArray[Any]) -> None:
    """Write an image, its channels as BGR."""
    assert cv2.imwrite(str(path), image)
