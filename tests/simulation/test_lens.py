"""The lens against the thin-lens equation, closed forms, another ray caster, and more rays."""

import math
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.blur.light import encode
from dfdbench.optics.thin_lens import ThinLens
from dfdbench.simulation import lens as lens_module
from dfdbench.simulation.lens import Camera, depth, develop, render
from dfdbench.simulation.raycast import Texture, look
from dfdbench.simulation.rooms import draw_room
from dfdbench.simulation.shapes import UPRIGHT, Panel, Scene, pack
from dfdbench.simulation.unseen import draw_camera
from tests.simulation.through_lens import demo_scene, through_lens

Floats = NDArray[np.float64]
FOCAL, PITCH = 0.025, 3.5e-5
WHITE, BLACK = Texture("plain", 100), Texture("plain", 100, (0.0, 0.0, 0.0))
PHOTOGRAPHS = {"plain": np.ones((4, 4, 3))}


def camera(focus: float = 1.0, f_number: float = 2.0, size: int = 64, **options: object) -> Camera:
    return Camera(ThinLens(f_number, FOCAL, focus, PITCH), (size, size), **options)  # type: ignore[arg-type]


def in_front_of_black(board: Panel) -> Scene:
    return pack([board, Panel((0, 0, 20), UPRIGHT, (99, 99), BLACK)], PHOTOGRAPHS)


def dot(z: float, x: float = 0.0, pixels: float = 1.0) -> Scene:
    """Return a white disc of so many pixels across, seen at x metres per metre of z."""
    size = pixels * PITCH / FOCAL * z
    return in_front_of_black(Panel((x * z, 0, z), UPRIGHT, (size, size), WHITE, "disc"))


def moments(light: Floats) -> tuple[float, float]:
    """Return the mean and the variance of x over the light, in pixels from the middle."""
    x = np.arange(light.shape[1]) - (light.shape[1] - 1) / 2
    weights = light.sum(axis=0) / light.sum()
    mean = float(weights @ x)
    return mean, float(weights @ (x - mean) ** 2)


def diameter(light: Floats) -> float:
    # A uniform disc's variance along an axis is d^2 / 16; the dot's own and a pixel's come on top.
    return 4 * math.sqrt(moments(light)[1] - 1 / 12 - 1 / 16)


def test_a_dot_is_as_wide_as_thin_lenses_say() -> None:
    cases = ((3.0, 1.0, 2.0), (0.7, 1.2, 2.0), (1.0, 3.0, 1.4), (2.5, 0.6, 4.0))
    for distance, focus, f_number in cases:
        taken = camera(focus, f_number)
        light = render(dot(distance), taken, 1024, (1,))[..., 1]
        gap = focus - FOCAL
        exact = abs(distance - focus) / distance * FOCAL**2 / (f_number * gap) / PITCH
        assert exact > 4
        assert diameter(light) == pytest.approx(exact, rel=0.02)
        assert float(taken.lens.blur_radius(distance)) / PITCH == pytest.approx(exact)


@pytest.mark.parametrize(("distance", "focus"), [(0.6, 1.5), (3.0, 0.9)])
def test_a_straight_edge_has_the_closed_form(distance: float, focus: float) -> None:
    taken = camera(focus)
    scene = in_front_of_black(Panel((-5, 0, distance), UPRIGHT, (10, 10), WHITE))
    seen = render(scene, taken, 1024, (2,))[..., 1].mean(axis=0)
    radius = abs(distance - focus) / distance * FOCAL**2 / (2 * (focus - FOCAL)) / PITCH / 2
    # The share of a disc to the right of a line, averaged over the pixel.
    x = np.arange(64)[:, np.newaxis] - 31.5 + np.linspace(-0.5, 0.5, 201)
    t = np.clip(x / radius, -1, 1)
    exact = (0.5 - (t * np.sqrt(1 - t * t) + np.arcsin(t)) / math.pi).mean(axis=1)
    assert np.abs(seen - exact).max() < 0.004


def test_the_lens_breathes_as_geometry_says_unless_images_are_in_register() -> None:
    def place(taken: Camera) -> float:
        return moments(render(dot(1.0, x=0.02, pixels=3), taken, 512, (3,))[..., 1])[0]

    places = [place(camera(focus, 8.0)) for focus in (0.4, 4.0)]
    still = [place(camera(focus, 8.0, view_focus=1.0)) for focus in (0.4, 4.0)]
    assert still[0] == pytest.approx(still[1], abs=0.02)
    sensor = [1 / (1 / FOCAL - 1 / focus) for focus in (0.4, 4.0)]
    assert places[0] == pytest.approx(0.02 * sensor[0] / PITCH, abs=0.02)
    assert places[0] / places[1] == pytest.approx(sensor[0] / sensor[1], abs=0.002)


def test_what_is_in_focus_is_as_sharp_as_through_a_pinhole() -> None:
    scene = dot(1.0, pixels=9)
    wide, small = (render(scene, camera(1.0, f), 256, (4,)) for f in (1.4, 1000.0))
    assert np.abs(wide - small).mean() < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["Market", "Library"])
def test_it_agrees_with_the_other_ray_caster(scene: str) -> None:
    surfaces, photographs = demo_scene(scene)
    facing = runpy.run_path(str(Path(__file__).parents[2] / "docs/tracks_by_rays.py"))["facing"]
    packed = pack([*map(facing, surfaces)], photographs)
    shape, focus = (48, 64), 1.2
    taken = Camera(ThinLens(2.0, FOCAL, focus, FOCAL / 165), shape)
    ours = encode(render(packed, taken, 256, (5,)))
    focal, radius = taken.focal_pixels, taken.lens_radius
    theirs = through_lens(scene, shape, focal, radius, focus, lambda view: view.reflectance)
    assert np.abs(ours - encode(theirs)).mean() < 0.8
    view = look(surfaces, photographs, 0.0, shape, focal)
    assert np.allclose(depth(packed, taken), view.distance, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.usefixtures("unlit")
def test_rays_are_many_enough() -> None:
    wide, room = draw_camera(3), draw_room(3, 1)
    for f_number in (2.0, 8.0):
        lens = replace(wide.lens, f_number=f_number, pixel_size=2 * wide.lens.pixel_size)
        taken = replace(wide, lens=lens, shape=(36, 48))
        few, many = (encode(render(room, taken, rays, (6,))) for rays in (128, 2048))
        assert np.abs(few - many).mean() < 0.5


@pytest.mark.slow
@pytest.mark.usefixtures("unlit")
def test_no_tile_leaves_out_what_its_rays_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = replace(draw_camera(5), shape=(48, 64))
    taken = replace(taken, lens=replace(taken.lens, pixel_size=10 * taken.lens.pixel_size))
    drawn = [draw_room(5, number) for number in range(2)]
    picked = [(render(room, taken, 8, (9,)), depth(room, taken)) for room in drawn]
    monkeypatch.setattr(lens_module, "_TILE", 10_000)
    monkeypatch.setattr(lens_module, "_tiles", _everything)
    for room, (light, metres) in zip(drawn, picked, strict=True):
        assert render(room, taken, 8, (9,)).tobytes() == light.tobytes()
        assert depth(room, taken).tobytes() == metres.tobytes()


def _everything(scene: Scene, *_: object) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    count = len(scene.kinds)
    return np.array([0, count]), np.arange(count), np.zeros(count)


def test_a_polygon_has_the_area_of_the_round_aperture_and_its_own_corners() -> None:
    taken = camera(0.6, 1.4, 96, blades=5)
    five = render(dot(6.0, pixels=2.5), taken, 1024, (10,))[..., 1]
    x = np.arange(96) - 47.5
    # Where light falls, from the equation: a pentagon in a circle, of the area of the lens's.
    blur = float(taken.lens.blur_radius(6.0)) / PITCH / 2
    turn = 2 * math.pi / 5
    inner = blur * math.sqrt(turn / math.sin(turn)) * math.cos(turn / 2)
    sides = [x[:, np.newaxis] * math.sin(a) + x * math.cos(a) for a in turn * np.arange(5)]
    depths = [inner - np.max(way * np.array(sides), axis=0) for way in (-1, 1)]
    middle = five[43:53, 43:53].mean()
    found = [five[depth > 2].min() > middle / 4 and five[depth < -2].max() == 0 for depth in depths]
    assert sorted(found) == [False, True]
    assert five.sum() / middle == pytest.approx(math.pi * blur**2, rel=0.03)


def test_light_falls_off_with_the_fourth_power_of_the_cosine() -> None:
    wall = pack([Panel((0, 0, 2), UPRIGHT, (99, 99), WHITE)], PHOTOGRAPHS)
    light = render(wall, camera(size=400, cos4=True), 4, (11,))[200, :, 0]
    angle = np.arctan((np.arange(400) - 199.5) / camera().focal_pixels)
    assert np.allclose(light, np.cos(angle) ** 4, rtol=1e-4)


def test_a_ring_darkens_corners_only() -> None:
    wall = pack([Panel((0, 0, 2), UPRIGHT, (99, 99), WHITE)], PHOTOGRAPHS)
    radius = camera().lens_radius
    ringed = camera(size=100, ring=(0.03, radius * 1.4))
    ringed = replace(ringed, lens=replace(ringed.lens, pixel_size=4 * PITCH))
    light = render(wall, ringed, 512, (12,))[..., 0]
    assert light[47:53, 47:53].min() == 1
    # Two discs of the lens's and the ring's radius, apart by 0.03 times the slope of the view.
    apart = 0.03 * 198 * math.sqrt(2) / camera().focal_pixels
    shared = _overlap(radius, radius * 1.4, apart)
    assert light[::99, ::99].mean() == pytest.approx(shared, abs=0.01)


def _overlap(a: float, b: float, apart: float) -> float:
    place = np.linspace(-a, a, 2001)
    x, y = np.meshgrid(place, place)
    inside = x * x + y * y <= a * a
    return float(((x - apart) ** 2 + y * y <= b * b)[inside].mean())


@pytest.mark.slow
def test_colour_errors_move_and_widen_channels_as_stated() -> None:
    scene = dot(2.0, x=0.03, pixels=3)
    light = render(scene, camera(1.0, 4.0, lateral=(0.05, 0.0, -0.05)), 256, (13,))
    places = [moments(light[..., channel])[0] for channel in range(3)]
    assert places[0] / places[1] == pytest.approx(1.05, abs=0.003)
    assert places[2] / places[1] == pytest.approx(0.95, abs=0.003)
    light = render(dot(2.0), camera(longitudinal=(0.2, 0.0, -0.2)), 2048, (14,))
    focal = camera().focal_pixels
    for channel, power in enumerate((1.2, 1.0, 0.8)):
        exact = 2 * camera().lens_radius * abs(power - 1 / 2.0) * focal
        assert diameter(light[..., channel]) == pytest.approx(exact, rel=0.02)


@pytest.mark.parametrize("level", [0.1, 0.5])
def test_noise_has_the_stated_variance(level: float) -> None:
    taken = camera(full_well=5000.0, read_noise=0.01, encoding="linear")
    image = develop(np.full((400, 400, 3), level), taken, (15,)).astype(np.float64) / 255
    exact = 0.01**2 + level / 5000 + (1 / 255**2 + 1 / 4095**2) / 12
    assert image.mean() == pytest.approx(level, abs=1e-3)
    assert image.var() == pytest.approx(exact, rel=0.02)


def test_the_file_is_srgb_of_8_bits_and_jpeg_is_close_to_it() -> None:
    ramp = np.linspace(0, 1.2, 64 * 64).reshape(64, 64, 1).repeat(3, axis=2)
    image = develop(ramp, camera(), (16,))
    assert np.abs(image - encode(ramp)).max() <= 2
    assert image.max() == 255
    packed = develop(ramp, camera(jpeg=90), (16,)).astype(int)
    assert 0 < np.abs(packed - image).max() < 12
