"""How well `dfdbench rig register` finds simulated rigs again: the numbers in docs/realworld.md."""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.optics.lens_table import read_lens_table
from dfdbench.rig.geometry import CaptureRig, Pose
from dfdbench.rig.lidar import average_scans, depth_image, read_beams, warp
from dfdbench.rig.registration import register, sight
from dfdbench.rig.sighting import Sighting
from dfdbench.simulation.board_scene import MOUNTED, SimulatedScene, defocus

SEED = 2019
LARGEST_TURN = 1.2  # degrees
TOGETHER = 4  # scenes of one rig: a texture's four geometries
TEXTURES = 16
PLACES = np.array([[[10.0, 10], [620, 10], [620, 620], [10, 620], [315, 315]]])

Row = tuple[int, float, float, float, float]


def main() -> None:
    """Register 16 rigs of four scenes each, as mounted and turned at random, and one by one."""
    turns = np.random.default_rng(SEED).uniform(-LARGEST_TURN, LARGEST_TURN, (TEXTURES, 3))
    found: dict[str, list[Row]] = {}
    for texture in range(TEXTURES):
        numbers = range(TOGETHER * texture, TOGETHER * (texture + 1))
        images = {number: captured(number) for number in numbers}
        for mount, pose in (("default", MOUNTED), ("random", Pose(*map(float, turns[texture])))):
            rows = list(registered(images, pose, together=True))
            found.setdefault(f"{mount} mount, four scenes together", []).extend(rows)
            rows = list(registered(images, pose, together=False))
            found.setdefault(f"{mount} mount, one scene alone", []).extend(rows)
    for name, measured in found.items():
        tell(name, np.array(measured))


def captured(number: int) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return a scene's sharp frame, and the true depth levels of its crop."""
    scene = SimulatedScene(number)
    view = scene.look()
    light = defocus(view, read_lens_table(), 135)
    frames = [scene.frame(light, 40, (135, 40, n)) for n in range(4)]
    frame = np.rint(np.mean(frames, axis=0)).astype(np.uint8)
    return frame, scene.truth(view).astype(np.int64) // 10


def registered(
    images: dict[int, tuple[NDArray[np.uint8], NDArray[np.int64]]], pose: Pose, together: bool
) -> Iterator[Row]:
    """Yield each scene: number, pixels off, pixels known to, depth within 2 levels, valid."""
    rig, beams = CaptureRig(), read_beams()
    sightings: dict[str, Sighting] = {}
    scans = {}
    for number, (frame, _) in images.items():
        scene = SimulatedScene(number, pose=pose)
        scans[number] = average_scans([scene.scan(beams, n) for n in range(5)])
        sightings[str(number)] = sight(frame, scans[number], beams, rig)
    groups = [sightings] if together else [{name: one} for name, one in sightings.items()]
    for group in groups:
        found, problems = register(group, rig)
        assert not problems, problems
        for name, one in found.items():
            truth = sightings[name].rays.matrix(pose, rig)
            source = cv2.perspectiveTransform(PLACES, np.linalg.inv(truth))
            moved = cv2.perspectiveTransform(source, one.matrix)
            shift = float(np.linalg.norm(moved - PLACES, axis=-1).max())
            image = depth_image(scans[int(name)], beams)
            depth, valid = warp(*image, one.matrix, (rig.crop_size, rig.crop_size))
            near = np.abs(depth.astype(int) - images[int(name)][1])[valid] <= 2
            yield int(name), shift, one.known_to, float(near.mean()), float(valid.mean())


def tell(name: str, rows: NDArray[np.float64]) -> None:
    """Print what was found of some scenes."""
    number, shift, known_to, near, valid = rows.T
    print(f"{name}, {len(rows)} scenes")
    for what, geometries in (("oblique", (1, 2)), ("flat", (0, 3))):
        chosen = np.isin(number % 4, geometries)
        told = (shift > 3) & (known_to > 3)
        print(
            f"  {what} boards: off by {np.median(shift[chosen]):.2f} pixels (median), "
            f"{shift[chosen].max():.2f} (largest), {(shift[chosen] > 3).sum()} over 3, "
            f"{told[chosen].sum()} of them told"
        )
    print(
        f"  depth within 2 levels on {100 * near.min():.2f} % of the valid pixels or more, "
        f"{100 * valid.min():.1f} % valid or more"
    )


if __name__ == "__main__":
    main()
