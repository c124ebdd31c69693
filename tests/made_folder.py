"""A small captured set in a folder: four scenes, two photographs and depth in millimetres each."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.building.build import build_store
from dfdbench.building.new_manifest import NewManifest, new_manifest
from dfdbench.building.sources import open_source
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest

SHAPE = (72, 96)
SCENES = ("desk", "door", "lamp", "shelf")
#: How the camera moved between the two photographs: pixels right and down.
MOVED = (2, -1)

FOLDER_TOML = """
schema_version = 1
name = "mine"
short = "mine"
version = 1
title = "My captures"
description = "Four scenes for tests."
reader = "folder"
degradation = "clean"
network_crop = 64
scene_count = 4
pair_count = 4
sources = [{ name = "me", url = "https://example.org/mine", licence = "mine", citations = ["me"] }]
splits = [
    { name = "train", partition = "only", pairs = 2, scenes = ["desk", "door"] },
    { name = "test", partition = "only", pairs = 2, scenes = ["lamp", "shelf"] },
]

[axes]
capture = [1]

[depth]
axes = []
unknown = 0
grows_with = "nearness"
unit = "linear in 1/z from 0.5 m to 5 m"

[depth.scale]
near = 0.5
far = 5.0

[files]
infocus = "{scene}/sharp.png"
defocus = "{scene}/blurred.png"
depth = "{scene}/depth.png"
depth_unit = 0.001

[table]
blocks = "capture"
""" + "".join(f'\n[[scenes]]\nname = "{name}"\nsource = "me"\n' for name in SCENES)


def photograph(seed: int, shape: tuple[int, int] = SHAPE) -> NDArray[np.uint8]:
    """Return a textured RGB image that is larger than asked by 8 pixels on each side."""
    random = np.random.default_rng(seed)
    fine = random.uniform(0, 255, (shape[0] + 16, shape[1] + 16, 3))
    coarse = cv2.GaussianBlur(fine, (0, 0), 4)
    spread = 110 + 50 * (coarse - coarse.mean()) / coarse.std() + 0.15 * (fine - 128)
    return np.asarray(np.clip(spread, 10, 240), np.uint8)


def depth_in_millimetres() -> NDArray[np.uint16]:
    """Return a floor from 1 to 4 m whose first two columns are missing."""
    rows = np.linspace(4000, 1000, SHAPE[0])[:, np.newaxis]
    depth = np.repeat(rows, SHAPE[1], axis=1).astype(np.uint16)
    depth[:, :2] = 0
    return depth


def write_scene(folder: Path, seed: int) -> None:
    """Write one scene: the defocus image is blurred, moved by `MOVED` and darker."""
    whole = photograph(seed)
    blurred = cv2.GaussianBlur(whole, (0, 0), 1.5)
    right, down = MOVED
    sharp = whole[8:-8, 8:-8]
    moved = blurred[8 - down : -8 - down, 8 - right : -8 - right]
    folder.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(folder / "sharp.png"), sharp[..., ::-1])
    cv2.imwrite(str(folder / "blurred.png"), (0.9 * moved).astype(np.uint8)[..., ::-1])
    cv2.imwrite(str(folder / "depth.png"), depth_in_millimetres())


def make_folder(folder: Path) -> Path:
    """Write all scenes below a folder and return it."""
    for number, scene in enumerate(SCENES):
        write_scene(folder / scene, number)
    return folder


def rearranged(folder: Path, name: Callable[[int, str], str]) -> Path:
    """Write all scenes, each file as `name` calls it by its scene's number and what it shows."""
    made = make_folder(folder / "made")
    for number, scene in enumerate(SCENES):
        for kind in ("sharp", "blurred", "depth"):
            place = folder / "set" / name(number, kind)
            place.parent.mkdir(parents=True, exist_ok=True)
            (made / scene / f"{kind}.png").rename(place)
    return folder / "set"


def built(folder: Path) -> tuple[NewManifest, Dataset]:
    """Build a folder's set, beside it, by the manifest that is written for it."""
    written = new_manifest(folder)
    manifest = parse_manifest(written.toml.encode(), written.name)
    place = folder.with_name("built.zarr")
    report = build_store(manifest, open_source(manifest, folder), place)
    assert (report.problems, report.missing) == ((), ())
    return written, Dataset(place)
