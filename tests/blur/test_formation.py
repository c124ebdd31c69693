import hashlib
from collections.abc import Iterator
from statistics import NormalDist

import numpy as np
import pytest
import scipy.ndimage
import scipy.stats
from numpy.typing import NDArray

from dfdbench.blur import formation
from dfdbench.blur.law import noise_at
from dfdbench.blur.light import decode, encode
from dfdbench.blur.recipe import RECIPES, BlurRecipe
from dfdbench.blur.synthesis import synthesize
from dfdbench.blur.tracks import TRACKS, find_degradation
from dfdbench.errors import InputError
from dfdbench.methods.blurred import blurred_by

RECIPE = RECIPES["published"]
NAMES = [f"{name}-{severity}" for name in TRACKS for severity in (1, 2, 3)]


def made_scene(shape: tuple[int, int] = (60, 80)) -> formation.Images:
    """A smooth texture of middling grey levels on a slanted ground with a board before it."""
    random = np.random.default_rng(5)
    image = scipy.ndimage.gaussian_filter(random.uniform(-1, 1, (*shape, 3)), (1.5, 1.5, 0))
    depth = np.linspace(30, 120, shape[0])[:, np.newaxis] + np.zeros(shape[1])
    depth[shape[0] // 3 :, shape[1] // 2 :] = 220
    return (120 + 20 * image / image.std()).astype(np.uint8), depth.astype(np.uint8)


IMAGE, DEPTH = made_scene()
CLEAN = synthesize(IMAGE, DEPTH, RECIPE)


def formed(
    label: str, pair: str = "Art/view1", scene: formation.Images = (IMAGE, DEPTH)
) -> formation.Images:
    return formation.form_pair(*scene, RECIPE, find_degradation(label), pair)


def off(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.float64]:
    return first.astype(np.float64) - second.astype(np.float64)


@pytest.mark.parametrize("name", TRACKS)
def test_severity_0_is_clean_in_every_byte(name: str) -> None:
    infocus, defocus = formed(f"{name}-0")
    assert np.array_equal(infocus, IMAGE)
    assert np.array_equal(defocus, CLEAN)


def test_noise_has_its_sigma_on_both_images_and_is_each_image_s_own() -> None:
    infocus, defocus = formed("noise-2")
    first, second = off(infocus, IMAGE), off(defocus, CLEAN)
    assert first.std() == pytest.approx(3, rel=0.05)
    assert second.std() == pytest.approx(3, rel=0.05)
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.03
    other = off(formed("noise-2", "Art/view5")[0], IMAGE)
    assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.03


def test_the_hidden_law_is_another_recipe_and_nothing_else() -> None:
    infocus, defocus = formed("law-3")
    assert np.array_equal(infocus, IMAGE)
    hidden = BlurRecipe(0.32 * 1.2461, 0.01125 * 1.2914)
    assert np.array_equal(defocus, synthesize(IMAGE, DEPTH, hidden))


@pytest.mark.parametrize("severity", [1, 2, 3])
def test_a_shift_is_as_long_as_it_says_and_blurs_nothing(severity: int) -> None:
    pixels = TRACKS["shift"].severities[severity - 1].shift
    turns = []
    for pair in ("Art/view1", "Art/view5", "Books/view1"):
        infocus, defocus = formed(f"shift-{severity}", pair)
        assert np.array_equal(infocus, IMAGE)
        inside = (slice(8, -8), slice(8, -8))
        plain = CLEAN.mean(axis=2)
        slopes = np.stack([slope[inside].ravel() for slope in np.gradient(plain)], axis=1)
        seen = off(defocus, CLEAN).mean(axis=2)[inside].ravel()
        (down, right), *_ = np.linalg.lstsq(slopes, -seen)
        assert np.hypot(down, right) == pytest.approx(pixels, rel=0.1)
        turns.append(np.arctan2(down, right))
        assert defocus.std() == pytest.approx(CLEAN.std(), rel=0.02)
    assert np.ptp(turns) > 0.3


def test_moving_there_and_back_is_staying() -> None:
    smooth = scipy.ndimage.gaussian_filter(IMAGE.astype(float), (1, 1, 0))
    back = formation.move(formation.move(smooth, 0.3, -0.6), -0.3, 0.6)
    assert np.abs(back - smooth)[9:-9, 9:-9].max() < 0.5


def test_a_gain_lies_within_its_bounds_both_ways_and_leaves_the_in_focus_image() -> None:
    gains = []
    for number in range(12):
        infocus, defocus = formed("gain-3", f"pair {number}")
        assert np.array_equal(infocus, IMAGE)
        gains.append(defocus.mean() / CLEAN.mean() - 1)
    assert -0.1 <= min(gains) < -0.03
    assert 0.03 < max(gains) <= 0.1


def test_a_camera_blurs_light_not_grey_levels() -> None:
    image, depth = np.zeros((60, 60, 3), np.uint8), np.zeros((60, 60), np.uint8)
    image[:, ::2] = 255
    _, defocus = formed("camera-1", scene=(image, depth))
    assert synthesize(image, depth, RECIPE).mean() == pytest.approx(127.5, abs=1)
    # Half the light of white is grey level 188.
    assert defocus[20:40, 20:40].mean() == pytest.approx(188, abs=3)


@pytest.mark.parametrize("grey", [90, 150, 230])
def test_a_camera_s_noise_follows_the_light(grey: int) -> None:
    scene = np.full((90, 90, 3), grey, np.uint8), np.full((90, 90), 200, np.uint8)
    light = float(decode(np.array([grey]))[0])
    for severity, (read, full) in enumerate(((0.001, 1e4), (0.003, 1e4 / 3), (0.01, 1e3)), 1):
        sigma = np.sqrt(light / full + read**2)
        above, below = encode(np.array([light + 1e-6, light - 1e-6]))
        expected = np.hypot(sigma * (above - below) / 2e-6, 1 / np.sqrt(12))
        for photograph in formed(f"camera-{severity}", "flat", scene):
            assert photograph.std() == pytest.approx(expected, rel=0.08)
            assert photograph.mean() == pytest.approx(grey, abs=1.5)


def test_wrong_input_is_named() -> None:
    with pytest.raises(InputError, match="sizes differ"):
        formation.form_pair(IMAGE, DEPTH[1:], RECIPE, find_degradation("noise-1"), "a")


# What the released tracks make of a small scene; a line changes only with its track's version.
PINNED = {
    "noise-1": "3911ee4ac48657b6", "noise-2": "302db44cab44c29d", "noise-3": "e325de331ce0c0a6",
    "psf-1": "8dd0347d406c8c80", "psf-2": "d6fe42f81b29b6fb", "psf-3": "1fc9ea965c870bbf",
    "law-1": "7360d7378f7c9f24", "law-2": "ee0d44015e3ad0c2", "law-3": "a73deab39ab29d51",
    "occlusion-1": "14ed6f260f4204b9", "occlusion-2": "fd78bd82cef996c7",
    "occlusion-3": "21c63fde86cc9a23",
    "shift-1": "84e252e6bbd22371", "shift-2": "27284254f27b758b", "shift-3": "72f8c76b4de97f9b",
    "gain-1": "7d805095303e3351", "gain-2": "1cddea9294c3bf64", "gain-3": "70db627697b6ba91",
    "camera-1": "6220dc639b917ff3", "camera-2": "41a13ebd68afa8c5", "camera-3": "5dcef71336707434",
    "magnification-1": "1c1327bf18b1b37e", "magnification-2": "9d448317ca383114",
    "magnification-3": "e450025208874e84",
    "vignetting-1": "5a734846e97f35b2", "vignetting-2": "020ae853a732f45a",
    "vignetting-3": "37b1281feeb6b15d",
    "colour-1": "c4f16ea76f24c0f7", "colour-2": "52580c6f4a5f35e2", "colour-3": "9eb97f5362a920dd",
    "lens-1": "e6bda23e14b68381", "lens-2": "05ceeb9ff87fa4d1", "lens-3": "6fd4083d9d27bc67",
}  # fmt: skip


@pytest.mark.parametrize("label", NAMES)
def test_what_a_released_track_makes_never_changes(label: str) -> None:
    pair = formed(label, "Art/view1/exposure0", made_scene((24, 32)))
    digest = hashlib.sha256(pair[0].tobytes() + pair[1].tobytes()).hexdigest()
    assert digest[:16] == PINNED[label]


def one_by_one(count: int, text: str) -> list[float]:
    """Philox by its paper (Salmon et al. 2011, 4 x 64, ten rounds) in Python's integers."""
    word = 2**64 - 1
    digest = hashlib.sha256(text.encode()).digest()
    keys = [int.from_bytes(digest[8 * n : 8 * n + 8], "little") for n in range(2)]
    numbers: list[float] = []
    block = 0
    while len(numbers) < count:
        block += 1
        a, b, c, d = block, 0, 0, 0
        k, m = keys
        for _ in range(10):
            first, second = 0xD2E7470EE14C6C93 * a, 0xCA5A826395121157 * c
            a, b, c, d = (second >> 64) ^ b ^ k, second & word, (first >> 64) ^ d ^ m, first & word
            k, m = (k + 0x9E3779B97F4A7C15) & word, (m + 0xBB67AE8584CAA73B) & word
        for bits in (a, b, c, d):
            numbers += [((bits & 0xFFFFFFFF) + 0.5) / 2**32, ((bits >> 32) + 0.5) / 2**32]
    return numbers[:count]


def test_the_numbers_are_those_of_the_generator_s_paper() -> None:
    expected = one_by_one(21, '["camera", 1, "Art/view1"]')
    assert formation.uniform_numbers(21, "camera", 1, "Art/view1").tolist() == expected
    normal = formation.normal_numbers((3, 7), "camera", 1, "Art/view1")
    inverse = NormalDist().inv_cdf
    assert np.allclose(normal.ravel(), [inverse(number) for number in expected], atol=1e-9)


def test_they_are_normal() -> None:
    numbers = formation.normal_numbers((300, 300), "many")
    assert scipy.stats.kstest(numbers.ravel(), "norm").pvalue > 0.01
    beside = np.corrcoef(numbers[:, :-1].ravel(), numbers[:, 1:].ravel())[0, 1]
    assert abs(beside) < 0.01


def test_the_law_explains_a_plane_of_every_track() -> None:
    # A plane shows nothing of layers: what is left of it is the noise that the law tells.
    random = np.random.default_rng(0)
    image = random.integers(60, 190, (64, 64, 3)).astype(np.uint8)
    depth = np.full((64, 64), 100, np.uint8)
    for label in NAMES:
        if label.startswith(("occlusion", "colour", "lens")):
            continue
        infocus, defocus = formed(label, scene=(image, depth))
        law = formation.given_law(RECIPE, find_degradation(label).formation)
        blurred = blurred_by(law, infocus, defocus, np.array([100]))
        inner = (slice(12, -12), slice(12, -12))
        left = (blurred.nodes @ blurred.factors[:, 0] - blurred.aim)[inner]
        expected = blurred.noise[inner] * np.sqrt(blurred.spread[0])
        assert np.sqrt(np.mean(np.square(left / expected))) == pytest.approx(1, abs=0.25), label


def test_noise_is_what_a_grey_patch_shows() -> None:
    scene = np.full((64, 64, 3), 90, np.uint8), np.zeros((64, 64), np.uint8)
    for label in ("noise-3", "camera-3"):
        _, defocus = formed(label, scene=scene)
        law = formation.given_law(RECIPE, find_degradation(label).formation)
        said = noise_at(law.noise, np.array(90.0))
        seen = 255 * decode(defocus.astype(float)) if law.linear else defocus
        assert float(seen.std()) == pytest.approx(float(said), rel=0.05)


def test_what_a_law_cannot_say_it_leaves_to_be_found_a_pair() -> None:
    ways = (find_degradation(label).formation for label in ("shift-2", "gain-2"))
    shift, gain = (formation.given_law(RECIPE, way) for way in ways)
    assert (shift.registered, shift.even) == (False, True)
    assert (gain.registered, gain.even) == (True, False)


def spots(label: str, channel: int, places: list[tuple[int, int]]) -> Iterator[NDArray[np.float64]]:
    """Yield where a track puts the centres of light spots, and how much light each has."""
    dots = np.full((201, 301, 3), 40, np.uint8)
    for y, x in places:
        dots[y - 1 : y + 2, x - 1 : x + 2] = 120
    near = np.full(dots.shape[:2], 255, np.uint8)
    for image in formed(label, scene=(dots, near)):
        light = decode(image[..., channel].astype(float))
        light -= light[5, 5] if label.startswith(("magn", "col")) else 0
        found = []
        for y, x in places:
            window = light[y - 7 : y + 8, x - 7 : x + 8]
            rows, columns = np.mgrid[y - 7 : y + 8, x - 7 : x + 8]
            found.append([(rows * window).sum(), (columns * window).sum()] / window.sum())
        yield np.array(found)


def test_magnification_moves_spots_away_from_the_middle() -> None:
    places = [(30, 40), (160, 250), (100, 150)]
    sharp, larger = spots("magnification-3", 1, places)
    moved = 0.012 * (np.array(places) - [100, 150])
    np.testing.assert_allclose(sharp, places, atol=0.01)
    np.testing.assert_allclose(larger - places, moved, atol=0.03)


def test_colour_moves_red_and_blue_apart_in_both_images_and_blurs_them_more() -> None:
    places = [(30, 40), (160, 250)]
    for channel, side in ((0, 1), (1, 0), (2, -1)):
        for found in spots("colour-3", channel, places):
            moved = side * 0.0016 * (np.array(places) - [100, 150])
            np.testing.assert_allclose(found - places, moved, atol=0.03)
    _, defocus = formed("colour-3")
    wider = BlurRecipe(0.32 + 16 * 0.01125, 0.01125)
    _, farther = formation.form_pair(IMAGE, DEPTH, wider, find_degradation("noise-0"), "a")
    assert np.array_equal(defocus[..., 1], CLEAN[..., 1])
    assert np.abs(off(defocus[..., 0], farther[..., 0])).mean() < 0.6


def test_vignetting_takes_light_from_the_corners_of_the_defocus_image() -> None:
    grey = np.full((60, 80, 3), 180, np.uint8)
    depth = np.zeros((60, 80), np.uint8)
    for severity, share in ((1, 0.1), (2, 0.2), (3, 0.35)):
        infocus, defocus = formed(f"vignetting-{severity}", scene=(grey, depth))
        assert np.array_equal(infocus, grey)
        light = decode(defocus.astype(float)) / decode(np.array([180.0]))
        assert light[0, 0] == pytest.approx(1 - share, abs=0.01)
        assert light[30, 40] == pytest.approx(1, abs=0.01)
        assert (np.diff(light[30, 40:, 0]) <= 0).all()
