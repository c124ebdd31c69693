from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from dfdbench.blur.light import decode, encode
from dfdbench.building.sources import matching
from dfdbench.building.sources.matching import Matching, matching_of
from dfdbench.errors import InputError
from tests.made_folder import photograph


def moved(
    image: np.ndarray, right: float = 0, down: float = 0, degrees: float = 0, scale: float = 1
) -> np.ndarray:
    """Move an image by OpenCV, which turns anticlockwise for a positive angle."""
    centre = ((image.shape[1] - 1) / 2, (image.shape[0] - 1) / 2)
    matrix = cv2.getRotationMatrix2D(centre, -degrees, scale)
    matrix[:, 2] += np.array([right, down])
    return cv2.warpAffine(
        image, matrix, image.shape[1::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )


@pytest.mark.parametrize(("scale", "degrees"), [(1.0, 0.0), (1.012, 0.0), (0.99, 0.4)])
def test_magnification_and_rotation_are_measured_and_undone(scale: float, degrees: float) -> None:
    fixed = photograph(0, (370, 427))
    blurred = cv2.GaussianBlur(fixed, (0, 0), 1.5)
    image = moved(blurred, degrees=degrees, scale=scale)
    found = matching.find_placement(fixed, image, "similarity")
    back, covered = matching.place(image.astype(float), found)
    assert covered.mean() > 0.97
    inner = ndimage.binary_erosion(covered, iterations=8)
    assert np.abs(back - blurred)[inner].mean() < 1
    aim = matching.Placement(0, 0, -degrees, 1, scale)
    assert found.magnification == pytest.approx(scale, abs=3e-4)
    assert found.degrees == pytest.approx(-degrees, abs=0.02)
    assert found.at_corners(fixed.shape) == pytest.approx(aim.at_corners(fixed.shape), abs=0.1)


def test_fall_off_of_light_is_no_movement() -> None:
    # A bare wall with three pictures; grey levels as they are make 1.9 pixels of it.
    wall = np.full((240, 320, 3), 150, np.uint8)
    for seed, (y, x) in enumerate([(30, 40), (150, 60), (140, 220)]):
        wall[y : y + 60, x : x + 60] = photograph(seed, (44, 44))
    rows, columns = np.indices(wall.shape[:2])
    off = ((rows - 120) ** 2 + (columns - 160) ** 2) / (120**2 + 160**2)
    images = []
    for share, sigma in ((0.08, 0.5), (0.4, 1.5)):
        dimmed = cv2.GaussianBlur(wall, (0, 0), sigma) * (1 - share * off)[..., np.newaxis]
        images.append(np.rint(dimmed).astype(np.uint8))
    assert matching.find_placement(*images).at_corners(wall.shape) < 0.4


def test_images_of_two_scenes_are_refused() -> None:
    with pytest.raises(InputError, match="no alignment"):
        matching.find_placement(photograph(0), photograph(1), "euclidean")
    flat = np.full_like(photograph(0), 90)
    with pytest.raises(InputError, match="no alignment"):
        matching.find_placement(photograph(0), flat, "translation")


def test_the_gain_leaves_out_what_is_white() -> None:
    image = photograph(2).astype(float)
    bright = np.clip(1.25 * image, 0, 255)
    everywhere = np.ones(image.shape[:2], bool)
    assert matching.find_gain(image, bright, everywhere) == pytest.approx(0.8, abs=0.005)
    with pytest.raises(InputError, match="differ too much"):
        matching.find_gain(image, 0.1 * image + 6, everywhere)
    with pytest.raises(InputError, match="all black or white"):
        matching.find_gain(image, np.full_like(image, 255), everywhere)


SHAPE = (200, 270)


def matched(gain: float = 1, **how: float) -> Matching:
    """Measure three pairs of which one image is blurred, and moved about its centre."""
    pairs = []
    for seed in range(3):
        sharp = photograph(seed, SHAPE)
        blurred = moved(cv2.GaussianBlur(sharp, (0, 0), 1.2), **how)
        pairs.append((f"scene {seed}", sharp, np.rint(gain * blurred).astype(np.uint8)))
    return matching_of(pairs)


def test_what_is_proposed_is_what_was_measured() -> None:
    found = matched()
    assert (found.align, found.match_gain, found.open, found.found) == ("none", False, (), ())
    assert matched(right=1.3, down=-0.7).align == "translation"
    assert matched(degrees=0.3).align == "euclidean"
    found = matched(gain=0.9)
    assert (found.align, found.match_gain) == ("none", True)
    assert found.found[-1] == "photographs differ in brightness by up to 11.1 %"


def test_blur_of_light_is_no_difference_in_brightness() -> None:
    # It keeps the light, so the grey levels of a picture with much contrast grow.
    sharp = np.where(photograph(0, SHAPE) > 128, 220, 30).astype(np.uint8)
    light = cv2.GaussianBlur(decode(sharp.astype(float)), (0, 0), 2).astype(np.float64)
    blurred = np.rint(encode(light)).astype(np.uint8)
    everywhere = np.ones(sharp.shape[:2], bool)
    assert matching.find_gain(sharp.astype(float), blurred.astype(float), everywhere) < 0.97
    assert not matching_of([("desk", sharp, blurred)]).match_gain
    dimmed = np.rint(encode(0.8 * light)).astype(np.uint8)
    assert matching_of([("desk", sharp, dimmed)]).match_gain


def test_one_pair_that_seems_moved_is_asked_about_and_moves_no_other() -> None:
    pairs = [(f"scene {seed}", photograph(seed, SHAPE)) for seed in range(3)]
    still = [(name, sharp, moved(cv2.GaussianBlur(sharp, (0, 0), 1.2))) for name, sharp in pairs]
    sharp = photograph(3, SHAPE)
    odd = np.rint(moved(cv2.GaussianBlur(sharp, (0, 0), 1.2), scale=1.006)).astype(np.uint8)
    found = matching_of([*still, ("desk", sharp, odd)])
    assert (found.align, found.found) == ("none", ())
    assert found.open == ("whether 1 of 4 pairs moved, as the others did not: desk by 1.1 pixels?",)
    # A camera makes all pairs larger, or all smaller.
    both = [(str(by), sharp, moved(sharp, scale=by).astype(np.uint8)) for by in (0.99, 1.01)]
    assert matching_of(both).align == "none"


def darker(image: NDArray[Any], by: float) -> NDArray[np.uint8]:
    middle = (np.array(image.shape[:2]) - 1) / 2
    y, x = np.indices(image.shape[:2]) - middle[:, np.newaxis, np.newaxis]
    radius = (y**2 + x**2) / (middle**2).sum()
    dark = encode(decode(image.astype(float)) * (1 - by * radius)[..., np.newaxis])
    return np.asarray(np.rint(dark), np.uint8)


def test_a_fall_off_that_several_pairs_share_becomes_a_flat_field() -> None:
    sharps = [photograph(seed, (300, 400)) for seed in range(3)]
    blurred = [cv2.GaussianBlur(sharp, (0, 0), 1.5) for sharp in sharps]
    pairs = [(str(n), sharps[n], darker(blurred[n], 0.2)) for n in range(3)]
    found = matching_of(pairs)
    assert [curve[-1] for curve in found.flat_field] == pytest.approx([0.8] * 3, abs=0.02)
    assert found.found[-1] == "the defocus images are 20 % darker at the corners than in the middle"
    # It hides neither a movement nor that the middle is as bright.
    pairs = [(str(n), sharps[n], darker(np.roll(blurred[n], 3, 1), 0.7)) for n in range(3)]
    found = matching_of(pairs)
    assert (found.align, found.match_gain, found.open) == ("translation", False, ())


def test_magnification_is_measured_at_the_corners_and_a_similarity_proposed() -> None:
    found = matched(scale=1.006)
    assert found.align == "similarity"
    starts = ("up to ", "magnified by ")
    corners, percent = (float(found.found[0].partition(s)[2].split()[0]) for s in starts)
    assert percent == pytest.approx(0.6, abs=0.03)
    assert corners == pytest.approx(0.006 * np.hypot(215, 285) / 2, abs=0.1)
    assert found.open == ()


def test_pairs_that_do_not_match_are_counted() -> None:
    first, second = (photograph(seed, SHAPE) for seed in range(2))
    found = matching_of([("desk", first, second), ("door", first, first[4:])])
    assert found.align == "none"
    assert found.open == (
        "photographs of door differ in size",
        "1 of 2 pairs tried cannot be aligned",
    )


def test_middlebury_s_barest_walls_have_not_moved(shared_data: Path) -> None:
    # Plastic has next to nothing to hold on to: fall-off and noise moved it by 1.9 pixels.
    random = np.random.default_rng(0)
    folder = shared_data / "middlebury/ThirdSize/Plastic"
    sharp = cv2.imread(str(folder / "view1.png"))
    if sharp is None:
        pytest.skip("no Plastic among the shared Middlebury images")
    rows, columns = np.indices(sharp.shape[:2])
    y, x = (np.array(sharp.shape[:2]) - 1) / 2
    off = (((rows - y) ** 2 + (columns - x) ** 2) / (y**2 + x**2))[..., np.newaxis]
    images = []
    for image, share in ((sharp, 0.08), (cv2.GaussianBlur(sharp, (0, 0), 2), 0.28)):
        noisy = image * (1 - share * off) + random.normal(0, 1.5, image.shape)
        images.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    assert matching_of([("Plastic", *images)]).align == "none"
