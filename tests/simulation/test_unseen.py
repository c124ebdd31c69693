import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from dfdbench.datasets.rendered import FAR, GENERATOR, NEAR
from dfdbench.simulation.lens import Camera, depth
from dfdbench.simulation.rooms import draw_room
from dfdbench.simulation.unseen import draw_camera, render_pair, render_stack, textured


def small(seed: int, times: int = 10) -> Camera:
    """The seed's camera with so many times fewer pixels across, and the same view."""
    camera = draw_camera(seed)
    lens = replace(camera.lens, pixel_size=times * camera.lens.pixel_size)
    return replace(camera, lens=lens, shape=(480 // times, 640 // times))


def test_a_camera_is_of_its_seed_or_of_its_seed_and_scene() -> None:
    assert draw_camera(5) == draw_camera(5) != draw_camera(6)
    assert draw_camera(5, scene=1) != draw_camera(5, scene=2)


@pytest.mark.usefixtures("unlit")
def test_a_pair_differs_in_the_aperture_alone_and_says_what_took_it() -> None:
    camera = replace(small(8), full_well=0.0, read_noise=0.0, jpeg=0)
    pair = render_pair(8, 0, camera, rays=64)
    assert NEAR <= pair.depth.min() < pair.depth.max() <= FAR
    sharp, blurred = pair.images
    assert 0.1 < np.abs(sharp.astype(int) - blurred).mean() < 20
    assert abs(sharp.mean() - blurred.mean()) < 3
    facts = json.loads(json.dumps(pair.facts))
    assert pair.focus_distances == (facts["focus_distance"],) == (camera.lens.focus_distance,)
    assert (facts["infocus_f_number"], facts["f_number"]) == (8, camera.lens.f_number)
    assert 0 <= facts["textured"] <= 1


@pytest.mark.usefixtures("unlit")
def test_a_pair_is_the_same_again_and_with_two_threads() -> None:
    one, two = (render_pair(9, 1, small(9), rays=8, threads=threads) for threads in (1, 2))
    for name in ("images", "depth"):
        assert np.array_equal(getattr(one, name), getattr(two, name))


def test_a_seed_gives_these_images_everywhere() -> None:
    # Raise GENERATOR when it changes: the same seed is then another set.
    pair = render_pair(9, 0, replace(small(9), jpeg=0), rays=8)
    digest = hashlib.sha256(pair.images.tobytes() + pair.depth.tobytes())
    assert (GENERATOR, digest.hexdigest()[:16]) == (1, "7a3d68ea6bfebf4a")


@pytest.mark.usefixtures("unlit")
def test_a_stack_is_in_register_and_sharpest_in_focus() -> None:
    plain = replace(small(3, 6), full_well=0.0, read_noise=0.0, jpeg=0, ring=None)
    stack = render_stack(3, 4, planes=5, camera=plain)
    assert stack.images.shape == (6, 80, 106, 3)
    assert list(stack.focus_distances) == sorted(stack.focus_distances)
    assert np.diff(1 / np.array(stack.focus_distances)) == pytest.approx(-0.3346, abs=1e-3)
    apart = np.abs(stack.images[1:].astype(int) - stack.images[0]).mean(axis=-1)
    powers = 1 / np.array(stack.focus_distances)
    nearest = np.abs(powers[:, np.newaxis, np.newaxis] - 1 / stack.depth).argmin(axis=0)
    own = np.take_along_axis(apart, nearest[np.newaxis], 0)[0]
    seen = textured(stack.images[0])
    assert own[seen].mean() < 0.75 * apart[:, seen].mean()


@pytest.mark.usefixtures("bare")
def test_a_lens_that_is_focused_elsewhere_breathes() -> None:
    camera = small(8)
    pair, other = (render_pair(8, 0, camera, rays=8, sharp_focus=focus) for focus in (None, 2.0))
    assert other.images.shape == pair.images.shape
    assert other.images[0].tobytes() != pair.images[0].tobytes()
    # The depth is still of the in-focus view.
    room, lens = draw_room(8, 0), replace(camera.lens, f_number=8.0, focus_distance=2.0)
    assert pair.depth.tobytes() == depth(room, camera).tobytes()
    assert other.depth.tobytes() == depth(room, replace(camera, lens=lens)).tobytes()
    assert other.depth.tobytes() != pair.depth.tobytes()


def test_texture_is_where_grey_levels_vary() -> None:
    image = np.full((40, 40, 3), 100, np.uint8)
    image[:, 20:] += np.random.default_rng(1).integers(0, 40, (40, 20, 1)).astype(np.uint8)
    found = textured(image)
    assert not found[:, :14].any()
    assert found[:, 26:].all()
