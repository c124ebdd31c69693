from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.blur.formation import decode, encode
from dfdbench.building.folder_matching import Matching, matching_of
from tests.made_folder import photograph

SHAPE = (300, 400)


def matched(
    right: float = 0, down: float = 0, degrees: float = 0, scale: float = 1, gain: float = 1
) -> Matching:
    """Measure three pairs of which one image is blurred, and moved about its centre."""
    pairs = []
    for seed in range(3):
        sharp = photograph(seed, SHAPE)
        blurred = moved(cv2.GaussianBlur(sharp, (0, 0), 1.2), right, down, degrees, scale)
        pairs.append((f"scene {seed}", sharp, np.rint(gain * blurred).astype(np.uint8)))
    return matching_of(pairs)


def moved(image: np.ndarray, right: float, down: float, degrees: float, scale: float) -> np.ndarray:
    centre = ((image.shape[1] - 1) / 2, (image.shape[0] - 1) / 2)
    matrix = cv2.getRotationMatrix2D(centre, -degrees, scale)
    matrix[:, 2] += np.array([right, down])
    return cv2.warpAffine(
        image, matrix, image.shape[1::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )


def test_nothing_is_proposed_if_nothing_moved() -> None:
    found = matched()
    assert (found.align, found.match_gain, found.open) == ("none", False, ())


def test_a_shift_asks_for_a_translation_and_a_turn_for_more() -> None:
    assert matched(right=1.3, down=-0.7).align == "translation"
    assert matched(degrees=0.3).align == "euclidean"


def test_gain_is_matched() -> None:
    found = matched(gain=0.9)
    assert (found.align, found.match_gain) == ("none", True)
    assert found.found[-1] == "photographs differ in brightness by up to 11.1 %"


def test_a_fall_off_that_several_pairs_share_becomes_a_flat_field() -> None:
    pairs = []
    for seed in range(3):
        sharp = photograph(seed, SHAPE)
        middle = (np.array(sharp.shape[:2]) - 1) / 2
        y, x = np.indices(sharp.shape[:2]) - middle[:, np.newaxis, np.newaxis]
        radius = (y**2 + x**2) / (middle**2).sum()
        light = decode(cv2.GaussianBlur(sharp, (0, 0), 1.5).astype(float))
        dark = encode(light * (1 - 0.2 * radius)[..., np.newaxis])
        pairs.append((str(seed), sharp, np.rint(dark).astype(np.uint8)))
    found = matching_of(pairs)
    assert [sum(curve) for curve in found.flat_field] == pytest.approx([0.8] * 3, abs=0.02)
    assert found.found[-1] == "the defocus images are 20 % darker at the corners than in the middle"


def test_magnification_is_measured_at_the_corners_and_a_similarity_proposed() -> None:
    found = matched(scale=1.006)
    assert found.align == "similarity"
    corners, percent = (
        float(found.found[0].partition(before)[2].split()[0])
        for before in ("up to ", "magnified by ")
    )
    assert percent == pytest.approx(0.6, abs=0.03)
    assert corners == pytest.approx(0.006 * np.hypot(315, 415) / 2, abs=0.1)
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
