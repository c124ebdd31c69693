"""Tests of what a camera changes beside the blur, on images whose formula is known everywhere."""

import re
from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.blur.light import decode, encode
from dfdbench.methods.view_change import Images, find_change

SHAPE = (150, 200)
Array = NDArray[np.float64]


def waves(number: int, down: Array, right: Array, sigma: float) -> Array:
    """Return light of many waves at any places, blurred by a Gaussian in closed form."""
    random = np.random.default_rng(number)
    light = np.full(np.broadcast(down, right).shape, 0.3)
    for length in random.uniform(5, 40, 60):
        angle, phase = random.uniform(0, 2 * np.pi, 2)
        wave = 2 * np.pi / length
        faded = np.exp(-((wave * sigma) ** 2) / 2)
        along = down * np.cos(angle) + right * np.sin(angle)
        light += 0.018 * faded * np.sin(wave * along + phase)
    return light


@cache
def pair(number: int, similarity: tuple[float, ...] = (0, 0, 0, 0), dark: float = 0) -> Images:
    """Return a pair whose defocus image is moved and has so much less light at the corners."""
    middle = (np.array(SHAPE) - 1) / 2
    down, right = np.mgrid[: SHAPE[0], : SHAPE[1]] - middle[:, np.newaxis, np.newaxis]
    radius = (down**2 + right**2) / (middle**2).sum()
    moved_down, moved_right, turn, larger = similarity
    # Where in the in-focus view each pixel of the other comes from.
    there = np.exp(-1j * turn) / (1 + larger) * (down - moved_down + 1j * (right - moved_right))
    light = waves(number, there.real, there.imag, 2) * (1 - dark * radius)
    lights = waves(number, down, right, 0), light
    sharp, blurred = (np.rint(encode(each)[..., np.newaxis]).astype(np.uint8) for each in lights)
    return Images(sharp, blurred)


# Smaller and moved; turned and larger.
@pytest.mark.parametrize("similarity", [(0.4, -0.3, 0.0, -0.012), (0.0, 0.0, 0.004, 0.002)])
def test_place_turn_and_size_are_found_and_undone(similarity: tuple[float, ...]) -> None:
    pairs = [pair(number, similarity) for number in range(4)]
    found = find_change(pairs)
    assert found.falloff == ()
    assert found.similarity[:2] == pytest.approx(similarity[:2], abs=0.05)
    assert found.similarity[2:] == pytest.approx(similarity[2:], abs=3e-4)
    images = pairs[0].defocus, found.undone(pairs[0].defocus)
    apart = [np.abs(image.astype(float) - pair(0).defocus)[8:-8, 8:-8].mean() for image in images]
    assert apart[1] < 0.4 < 0.6 < apart[0]


def test_the_fall_off_is_found_beside_a_magnification_and_undone() -> None:
    pairs = [pair(number, (0, 0, 0, 0.006), dark=0.25) for number in range(4)]
    found = find_change(pairs)
    steps = np.linspace(0, 1, 9)
    np.testing.assert_allclose(found.falloff[0], 1 - 0.25 * steps, atol=0.03)
    assert found.similarity[3] == pytest.approx(0.006, abs=3e-4)
    left = found.undone(pairs[0].defocus) - pair(0).defocus.astype(float)
    assert np.abs(left[8:-8, 8:-8]).mean() < 0.7
    said = r"0\.6\d % larger; 2[4-6] % darker at the corners than in the middle"
    assert re.fullmatch(said, found.words())
    # Images may differ in size.
    infocus, defocus = (image[5:-5, 8:-8] for image in (pairs[3].infocus, pairs[3].defocus))
    found = find_change([*pairs[:3], Images(infocus, defocus)])
    assert found.falloff[0][-1] == pytest.approx(0.75, abs=0.03)
    assert found.similarity[3] == pytest.approx(0.006, abs=3e-4)


def test_nothing_is_undone_where_nothing_changed() -> None:
    pairs = [pair(number) for number in range(4)]
    found = find_change(pairs)
    assert not found.changes
    assert not found.has_shadow
    assert found.undone(pairs[0].defocus) is pairs[0].defocus


def lit(number: int, by: Array) -> Images:
    """Return a pair whose defocus image has so many times as much light."""
    light = decode(pair(number).defocus.astype(float)) * by[..., np.newaxis]
    return pair(number)._replace(defocus=np.rint(encode(light)).astype(np.uint8))


def test_a_shadow_is_no_fall_off() -> None:
    shadow = np.where(np.arange(SHAPE[1]) < SHAPE[1] // 3, 0.7, 1) * np.ones(SHAPE)
    found = find_change([lit(number, shadow) for number in range(4)])
    assert found.falloff == ()
    assert found.has_shadow
    assert "a shadow?" in found.words()


def test_light_that_varies_from_capture_to_capture_is_no_shadow() -> None:
    fields = np.random.default_rng(0).normal(1, 0.08, (4, 12, 16))
    lights = [cv2.resize(field, SHAPE[::-1], interpolation=0) for field in fields]
    varied = [lit(number, np.asarray(light)) for number, light in enumerate(lights)]
    assert not find_change(varied).has_shadow


def test_two_captures_and_one_without_texture_say_nothing() -> None:
    assert not find_change([pair(number, (0, 0, 0, 0.01), dark=0.3) for number in (0, 1)]).changes
    flat = np.full((*SHAPE, 1), 90, np.uint8)
    assert not find_change([Images(flat, flat)] * 4).changes
