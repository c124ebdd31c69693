from concurrent.futures import ThreadPoolExecutor
from math import erfc
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter

from dfdbench.blur.light import encode
from dfdbench.blur.occlusion import GAP, composite_layers, without_tails
from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import blur_by_level, synthesize
from dfdbench.blur.tracks import DISK
from dfdbench.errors import InputError
from dfdbench.simulation.raycast import View, look
from tests.simulation.through_lens import demo_scene, through_lens

Floats = NDArray[np.float64]
RECIPE = RECIPES["published"]
# By depth level: brighter is nearer, and nearer is blurred less.
KERNELS = {p: point_spread_functions(RECIPE.sigmas, 27, p)[::-1] for p in (2.0, 3.0, DISK)}


def pixel_by_pixel(image: Floats, depth: NDArray[Any], kernels: Floats) -> Floats:
    """The formula word for word, gathered: what reaches a pixel, by depth, cut into surfaces."""
    reach = kernels.shape[1] // 2
    around = ((reach, reach), (reach, reach))
    wide, levels = np.pad(image, (*around, (0, 0)), mode="edge"), np.pad(depth, around, mode="edge")
    y, x = np.mgrid[: 2 * reach + 1, : 2 * reach + 1]
    out = np.empty_like(image)
    for place in np.ndindex(depth.shape):
        window = tuple(slice(at, at + 2 * reach + 1) for at in place)
        weights, near = kernels[levels[window], y, x], levels[window].ravel()
        alpha = np.bincount(near, weights.ravel(), len(kernels))
        light = np.stack(
            [np.bincount(near, (weights * wide[window][..., c]).ravel(), 256) for c in range(3)]
        )
        reached = np.flatnonzero(alpha)
        colour = np.zeros(3)
        surfaces = np.split(reached, np.flatnonzero(np.diff(reached) > GAP) + 1)
        for number, surface in enumerate(surfaces):
            whole = alpha[surface].sum()
            behind = kernels[surface[-1]][levels[window] < surface[0]].sum() if number else 0
            share = whole / (whole + behind)
            colour = (1 - share) * colour + share * light[:, surface].sum(axis=1) / whole
        out[place] = colour
    return out


def pixel_after_pixel(image: Floats, depth: NDArray[Any], kernels: Floats) -> Floats:
    """The same in the order of the sums: light spread pixel after pixel, layers laid in turn."""
    reach = kernels.shape[1] // 2
    around = ((reach, reach), (reach, reach))
    wide, levels = np.pad(image, (*around, (0, 0)), mode="edge"), np.pad(depth, around, mode="edge")
    height, width = depth.shape
    layers = {}
    for level in np.unique(levels):
        layer = layers[level] = np.zeros((height + 4 * reach, width + 4 * reach, 4))
        for y, x in np.argwhere(levels == level):
            light = np.array([1, *wide[y, x]])
            spread = kernels[level][..., np.newaxis] * light
            layer[y : y + 2 * reach + 1, x : x + 2 * reach + 1] += spread
    out = np.zeros((height, width, 4))
    for y, x in np.ndindex(height, width):
        window = levels[y : y + 2 * reach + 1, x : x + 2 * reach + 1]
        reached = [d for d, layer in layers.items() if layer[y + 2 * reach, x + 2 * reach, 0]]
        surfaces = np.split(reached, np.flatnonzero(np.diff(reached) > GAP) + 1)
        for number, surface in enumerate(surfaces):
            seen = sum(layers[d][y + 2 * reach, x + 2 * reach] for d in surface)
            behind = 0.0
            if number:
                columns = np.where(window < surface[0], kernels[surface[-1]], 0).sum(axis=0)
                behind = sum(columns.tolist())
            share = seen[0] / (seen[0] + behind)
            out[y, x] = (1 - share) * out[y, x] + share / seen[0] * seen
    return out[..., 1:]


def made_scene(seed: int) -> tuple[Floats, NDArray[np.uint8]]:
    """Noise on a slanted ground, a near board before it that reaches over the border, and dots."""
    random = np.random.default_rng(seed)
    depth = np.linspace(20, 120, 40)[:, np.newaxis] + np.linspace(0, 40, 52)
    depth[10:30, 25:] = 230
    depth[random.integers(0, 40, 9), random.integers(0, 52, 9)] = random.integers(0, 256, 9)
    image = random.integers(0, 256, (40, 52, 3)).astype(np.float64)
    return image, depth.astype(np.uint8)


@pytest.mark.parametrize("focus", ["near", "far"])
@pytest.mark.parametrize("exponent", list(KERNELS))
def test_it_is_the_formula(exponent: float, focus: str) -> None:
    image, depth = made_scene(int(exponent))
    kernels = without_tails(KERNELS[exponent][:: 1 if focus == "near" else -1])
    exact = pixel_by_pixel(image, depth, kernels)
    assert np.abs(composite_layers(image, depth, kernels) - exact).max() < 1e-9


@pytest.mark.parametrize("shape", [(1, 1), (3, 30), (17, 19)])
def test_it_is_the_formula_to_the_last_bit(shape: tuple[int, int]) -> None:
    random = np.random.default_rng(shape[1])
    image = random.uniform(0, 255, (*shape, 3))
    # Lone pixels, runs of all lengths and boards: what is spread together and what is not.
    depth = np.where(random.random(shape) < 0.3, random.integers(0, 256, shape), 40)
    depth[:, 10:15] = np.where(random.random((shape[0], 5)) < 0.8, 200, 203)[:, : shape[1] - 10]
    for kernels in (without_tails(KERNELS[2.0])[:, 4:-4, 4:-4], without_tails(KERNELS[DISK])):
        exact = pixel_after_pixel(image, depth, kernels)
        assert np.array_equal(composite_layers(image, depth, kernels), exact)
        assert np.array_equal(composite_layers(image[..., :2], depth, kernels), exact[..., :2])
        five = composite_layers(np.dstack([image, image[..., :2]]), depth, kernels)
        assert np.array_equal(five, np.dstack([exact, exact[..., :2]]))


@pytest.mark.parametrize("exponent", list(KERNELS))
def test_the_tails_left_out_are_less_than_a_grey_level(exponent: float) -> None:
    image, depth = made_scene(7)
    ours = composite_layers(image, depth, without_tails(KERNELS[exponent]))
    errors = np.abs(ours - pixel_by_pixel(image, depth, KERNELS[exponent])).max(axis=2)
    # A lone far pixel, seen through a hole of its own size, is the exception.
    assert np.quantile(errors, 0.999) < 1
    assert errors.max() < 2


@pytest.mark.parametrize("level", [0, 90, 255])
def test_one_depth_all_over_is_the_plain_blur(level: int) -> None:
    image, _ = made_scene(1)
    depth = np.full(image.shape[:2], level, np.uint8)
    layered = composite_layers(image, depth, without_tails(KERNELS[2.0]))
    plain = synthesize(image.astype(np.uint8), depth, RECIPE)
    assert np.abs(layered - plain).max() < 1


@pytest.mark.parametrize(("near", "far"), [(130, 20), (90, 0), (110, 60)])
@pytest.mark.parametrize("black_is_near", [True, False])
def test_a_straight_edge_has_the_closed_form(near: int, far: int, black_is_near: bool) -> None:
    # A near half plane before an endless ground is seen as the integral of its own kernel, and
    # the ground as what that leaves, whatever the ground's blur.
    colours = (0.0, 255.0) if black_is_near else (255.0, 0.0)
    columns = np.arange(60)
    is_near = np.broadcast_to(columns < 30, (60, 60))
    image = np.where(is_near, *colours)
    layered = composite_layers(
        image, np.where(is_near, near, far), without_tails(wide_kernels(near, far))
    )
    sigma = RECIPE.sigma_min + RECIPE.sigma_step * (255 - near)
    seen = np.array([0.5 * erfc((x - 29.5) / (sigma * 2**0.5)) for x in columns])
    exact = seen * colours[0] + (1 - seen) * colours[1]
    assert np.abs(layered[30] - exact).max() < 1.5
    assert layered[30, 29:31].mean() == pytest.approx(127.5, abs=1)


def wide_kernels(*levels: int) -> Floats:
    """Gaussians of the published widths whose tails are not cut by the recipe's size."""
    kernels = np.zeros((256, 41, 41))
    kernels[list(levels)] = point_spread_functions(RECIPE.sigmas[::-1][list(levels)], 41, 2.0)
    kernels[[level for level in range(256) if level not in levels], 20, 20] = 1
    return kernels


def test_a_far_ground_is_not_bled_into_a_sharp_board_before_it() -> None:
    # What the plain blur cannot do: there a pixel of the ground takes in the board's light.
    image = np.zeros((31, 40))
    image[:, 20:] = 200
    depth = np.where(image > 0, 255, 0).astype(np.uint8)
    kernels = without_tails(KERNELS[DISK])
    layered = composite_layers(image, depth, kernels)
    assert layered[:, :19].max() < 3
    assert layered[:, 21:].min() > 197
    assert blur_by_level(image, depth, kernels)[:, 15:19].min() > 10


@pytest.mark.parametrize("slope", [0.2, 1, GAP])
def test_a_slanted_plane_does_not_cover_itself(slope: float) -> None:
    image, _ = made_scene(6)
    depth = (slope * np.arange(31)[:, np.newaxis] + np.zeros(52)).astype(np.uint8)
    kernels = without_tails(np.repeat(KERNELS[2.0][:1], 256, axis=0))
    layered = composite_layers(image[:31], depth, kernels)
    assert np.allclose(layered, blur_by_level(image[:31], depth, kernels), rtol=1e-9)


def test_a_white_scene_stays_white_at_borders_and_behind_edges() -> None:
    image, depth = made_scene(3)
    white = np.full_like(image, 255)
    layered = composite_layers(white, depth, without_tails(KERNELS[2.0]))
    assert np.allclose(layered, 255, rtol=1e-12)


def test_a_grey_image_and_threads_at_work_at_once() -> None:
    image, depth = made_scene(4)
    kernels = without_tails(KERNELS[3.0])
    alone = composite_layers(image, depth, kernels)
    assert np.array_equal(composite_layers(image[..., 2], depth, kernels), alone[..., 2])
    with ThreadPoolExecutor(4) as pool:
        many = list(pool.map(lambda _: composite_layers(image, depth, kernels), range(8)))
    assert all(np.array_equal(one, alone) for one in many)


def test_wrong_input_is_named() -> None:
    image, depth = made_scene(5)
    with pytest.raises(InputError, match="no kernel"):
        composite_layers(image, depth, KERNELS[2.0][:100])
    with pytest.raises(InputError, match="sizes differ"):
        composite_layers(image[:9], depth, KERNELS[2.0])


# Against a lens: the demo scenes, by rays through many points of it.
SHAPE, FOCAL_LENGTH, LEVEL_AT_ONE_METRE = (240, 320), 330.0, 247.5
# The published recipe's disk: a radius of 0.0225 pixels a level, and level 255 in focus.
RADIUS_PER_LEVEL = 0.0225
FOCUS = LEVEL_AT_ONE_METRE / 255
LENS = RADIUS_PER_LEVEL * LEVEL_AT_ONE_METRE / FOCAL_LENGTH
BORDER = 12


def lit(view: View) -> Floats:
    """Return the light of a lamp above the camera."""
    facing = np.maximum(view.normal @ np.array([0.0, -0.6, -0.8]), 0)
    return np.asarray(view.reflectance * (0.5 + 0.5 * facing)[..., np.newaxis])


def by_pinhole(scene: str) -> tuple[Floats, NDArray[np.intp]]:
    """Return linear light and depth levels of a scene."""
    view = look(*demo_scene(scene), 0.0, SHAPE, FOCAL_LENGTH)
    return lit(view), np.rint(LEVEL_AT_ONE_METRE / view.distance).astype(np.intp)


def disks() -> Floats:
    """Return round kernels, their rims by the share of each pixel that lies inside."""
    fine = np.arange(-112, 113) / 15
    distance = np.hypot(fine[:, np.newaxis], fine)
    kernels = np.empty((256, 15, 15))
    for level in range(256):
        inside = distance <= max(RADIUS_PER_LEVEL * (255 - level), 0.5)
        kernels[level] = inside.reshape(15, 15, 15, 15).mean(axis=(1, 3))
    return np.asarray(kernels / kernels.sum(axis=(1, 2), keepdims=True))


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["Market", "Kitchen", "Attic", "Library"])
def test_jumps_of_depth_look_as_a_lens_shows_them(scene: str) -> None:
    lens = through_lens(scene, SHAPE, FOCAL_LENGTH, LENS, FOCUS, lit)
    pinhole, levels = by_pinhole(scene)
    kernels = disks()
    layered = np.abs(encode(composite_layers(pinhole, levels, kernels)) - encode(lens))
    plain = np.abs(encode(blur_by_level(pinhole, levels, kernels)) - encode(lens))
    jumps = maximum_filter(levels, 3) - minimum_filter(levels, 3) > GAP
    near_jumps = binary_dilation(jumps, iterations=5)
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    at, away = near_jumps[inner], ~near_jumps[inner]

    def rms(errors: Floats, where: NDArray[np.bool_]) -> float:
        return float(np.sqrt(np.mean(errors[inner][where] ** 2)))

    assert at.mean() > 0.05
    assert rms(layered, at) < 2.0
    assert rms(layered, at) < rms(plain, at)
    assert rms(layered, away) < 1.2
