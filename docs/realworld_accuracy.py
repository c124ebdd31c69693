"""How well `dfdbench register` finds simulated rigs again: the numbers in docs/realworld.md."""

import cv2
import numpy as np

from dfdbench.lens import read_lens_table
from dfdbench.lidar import average_scans, depth_image, warp
from dfdbench.lidar_files import read_beams
from dfdbench.registration import matrix_for, register
from dfdbench.rig import Pose
from dfdbench.simulator import MOUNTED, SimulatedScene, defocus

SCENES = 64
LARGEST_TURN = 1.2  # degrees
PLACES = np.array([[[10.0, 10], [620, 10], [620, 620], [10, 620], [315, 315]]])


def main() -> None:
    """Register all 64 scenes, once as mounted by default and once turned at random."""
    table, beams = read_lens_table(), read_beams()
    turns = np.random.default_rng(1).uniform(-LARGEST_TURN, LARGEST_TURN, (SCENES, 3))
    found: dict[str, list[tuple[int, float, float, float]]] = {"default": [], "random": []}
    for number in range(SCENES):
        scene = SimulatedScene(number)
        view = scene.look()
        light = defocus(view, table, 135)
        frames = [scene.frame(light, 40, (135, 40, n)) for n in range(4)]
        image = np.rint(np.mean(frames, axis=0)).astype(np.uint8)
        levels = scene.truth(view).astype(int) // 10
        for name, pose in (("default", MOUNTED), ("random", Pose(*map(float, turns[number])))):
            turned = SimulatedScene(number, pose=pose)
            ranges = average_scans([turned.scan(beams, n) for n in range(5)])
            matrix = register(image, ranges, beams, scene.rig).matrix
            truth = matrix_for(ranges, beams, scene.rig, pose)
            source = cv2.perspectiveTransform(PLACES, np.linalg.inv(truth))
            moved = cv2.perspectiveTransform(source, matrix)
            shift = float(np.linalg.norm(moved - PLACES, axis=-1).max())
            depth, valid = warp(*depth_image(ranges, beams), matrix, (630, 630))
            near = np.abs(depth.astype(int) - levels)[valid] <= 2
            found[name].append((number % 4, shift, float(near.mean()), float(valid.mean())))
    for name, rows in found.items():
        geometry, shift, near, valid = np.array(rows).T
        print(f"{name} mount, {len(rows)} scenes")
        for what, chosen in (
            ("oblique boards", (geometry == 1) | (geometry == 2)),
            ("flat boards", (geometry == 0) | (geometry == 3)),
        ):
            print(
                f"  {what}: off by {np.median(shift[chosen]):.2f} pixels (median), "
                f"{shift[chosen].max():.2f} (largest), {(shift[chosen] > 3).sum()} over 3"
            )
        print(
            f"  depth within 2 levels on {100 * near.min():.2f} % of the valid pixels or more, "
            f"{100 * valid.min():.1f} % valid or more"
        )


if __name__ == "__main__":
    main()
