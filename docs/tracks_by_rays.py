"""Compare the tracks with a lens: python docs/tracks_by_rays.py [PICTURE].

Each demo scene's geometry is photographed through a lens whose circle of confusion is as wide as
the published recipe's blur at every depth level. It is compared with what the tracks `occlusion`
and `camera` make of the pinhole's image, without noise. Printed are root mean squares in sRGB grey
levels, within 5 pixels of jumps of depth and away from them.
"""

from __future__ import annotations

import sys

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter

from dfdbench.blur.formation import blur
from dfdbench.blur.light import encode
from dfdbench.blur.occlusion import GAP
from dfdbench.blur.recipe import LAST_LEVEL, RECIPES
from dfdbench.blur.tracks import DISK, Formation, find_degradation
from dfdbench.building.sources.demo import SCENES
from dfdbench.optics.thin_lens import ThinLens
from dfdbench.simulation.lens import Camera, depth, render
from dfdbench.simulation.lighting import places_on
from dfdbench.simulation.photographs import photograph
from dfdbench.simulation.raycast import Board, Floor, Surface
from dfdbench.simulation.shapes import UPRIGHT, Panel, Round, Scene, Shape, Vector, pack

Floats = NDArray[np.float64]

SHAPE, FOCAL_PIXELS, LEVEL_AT_ONE_METRE = (240, 320), 330.0, 247.5
RECIPE = RECIPES["published"]
FOCAL_LENGTH = 0.025  # metres; any will do, as only pixels are compared
LAMP, AMBIENT = (0.0, -0.6, -0.8), 0.5
ENDLESS = 50.0  # metres: half the side of an infinite plane's stand-in
SHADE_SPACING = 0.02  # metres
RAYS, BORDER, NEAR_A_JUMP = 256, 12, 5
FORMATIONS = {
    "own blur": Formation(exponent=DISK, linear=True),
    "occlusion": find_degradation("occlusion-1").formation,
    "camera": find_degradation("camera-1").formation,
}


def camera(f_number: float | None = None) -> Camera:
    """Return the recipe's camera.

    A lens's blur is linear in level, which is disparity, and so is the recipe's sigma, half a
    disk's radius. It is 0 at the level in focus, nearer than any.
    """
    in_focus = LAST_LEVEL + RECIPE.sigma_min / RECIPE.sigma_step
    focus = LEVEL_AT_ONE_METRE / in_focus
    radius = 2 * RECIPE.sigma_step * LEVEL_AT_ONE_METRE / FOCAL_PIXELS
    sensor = FOCAL_LENGTH * focus / (focus - FOCAL_LENGTH)
    wide = FOCAL_LENGTH / (2 * radius)
    lens = ThinLens(f_number or wide, FOCAL_LENGTH, focus, sensor / FOCAL_PIXELS)
    return Camera(lens, SHAPE)


def facing(surface: Surface) -> Shape:
    """Return a demo scene's surface as one that faces any direction."""
    right, bottom, behind = UPRIGHT
    if isinstance(surface, Board):
        normal = np.array([-surface.slant, -surface.tilt, 1.0])
        x, y, z = normal / np.sqrt((normal * normal).sum())
        # Lengths across and down are measured along x and y, not along the slope.
        frame = (right, bottom, (float(x), float(y), float(z)))
        return Panel(surface.centre, frame, surface.size, surface.texture, surface.shape)
    if isinstance(surface, Floor):
        centre, side = (0.0, surface.height, 0.0), 2 * ENDLESS
        return Panel(centre, (right, behind, bottom), (side, side), surface.texture)
    return Round(surface.centre, UPRIGHT, surface.radius, surface.texture, surface.upright)


def shaded(scene: Scene, direction: Vector, ambient: float) -> Scene:
    """Return a scene shaded by an infinitely distant lamp without shadows, as in the demo scenes.

    `direction` is where the light comes from, `ambient` the share that falls equally everywhere.
    """
    charts, _, normals = places_on(scene, SHADE_SPACING)
    ahead = sum(normals[:, axis] * direction[axis] for axis in range(3))
    light = ambient + (1 - ambient) * np.maximum(ahead, 0)
    return scene._replace(charts=charts, lightmap=light.astype(np.float32))


def compare(scene: str) -> tuple[dict[str, tuple[float, float]], list[Floats]]:
    """Return rms at jumps and away by formation; the lens's image, and the formations'."""
    surfaces = SCENES[scene]
    photographs = {s.texture.photograph: photograph(s.texture.photograph) for s in surfaces}
    packed = shaded(pack([*map(facing, surfaces)], photographs), LAMP, AMBIENT)
    by_lens = encode(render(packed, camera(), RAYS, (1,)))
    sharp = render(packed, camera(1e6), RAYS, (2,))
    levels = np.rint(LEVEL_AT_ONE_METRE / depth(packed, camera())).astype(np.uint8)
    jumps = maximum_filter(levels, 3) - minimum_filter(levels, 3) > GAP
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    at = binary_dilation(jumps, iterations=NEAR_A_JUMP)[inner]
    found, images = {}, [by_lens]
    for name, formation in FORMATIONS.items():
        light = sharp if formation.linear else encode(sharp)
        made = blur(light, levels, RECIPE, formation)
        images.append(encode(made) if formation.linear else made)
        errors = np.square(images[-1] - by_lens)[inner]
        found[name] = (float(np.sqrt(errors[at].mean())), float(np.sqrt(errors[~at].mean())))
    return found, images


def main() -> None:
    """Print a table; write the scene with the largest error as a picture, if asked."""
    print("| scene | " + " | ".join(f"{name}: at jumps, away" for name in FORMATIONS) + " |")
    print("|:---|" + "---:|" * len(FORMATIONS))
    worst, shown = 0.0, []
    for scene in SCENES:
        found, images = compare(scene)
        cells = [f"{at:.2f}, {away:.2f}" for at, away in found.values()]
        print(f"| {scene} | " + " | ".join(cells) + " |", flush=True)
        if found["camera"][0] > worst:
            worst, shown = found["camera"][0], images
    if len(sys.argv) > 1:
        differences = [127.5 + 4 * (image - shown[0]) for image in shown[1:]]
        rows = [np.hstack([shown[0], *shown[1:]]), np.hstack([0 * shown[0] + 127.5, *differences])]
        picture = np.clip(np.rint(np.vstack(rows)), 0, 255).astype(np.uint8)
        heading = np.full((24, picture.shape[1], 3), 255, np.uint8)
        for number, name in enumerate(("lens, by rays", *FORMATIONS)):
            place = (number * SHAPE[1] + 6, 17)
            cv2.putText(
                heading, name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA
            )
        picture = np.vstack([heading, picture])
        cv2.imwrite(sys.argv[1], picture[..., ::-1])


if __name__ == "__main__":
    main()
