import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import spearmanr

from dfdbench.audit.difficulty import (
    STEPS,
    UNSEEN,
    Difficulty,
    difficulty_as_json,
    difficulty_rows,
    median_step,
    smallest_step,
)
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.methods.baselines import Local

RECIPE = RECIPES["published"]


def texture(contrast: float, seed: int = 0) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    noise = np.random.default_rng(seed).integers(-127, 128, (24, 24, 3))
    return np.asarray(128 + contrast * noise, np.uint8)


@pytest.mark.parametrize("noise", [0, 1, 3])
def test_a_step_is_seen_where_both_neighbours_are_stored_differently(noise: int) -> None:
    image, depth = texture(0.5), np.full((24, 24), 200, np.uint8)
    depth[:, 12:] = 255
    found = smallest_step(image, depth, depth > 0, RECIPE, noise)

    def stored(level: int) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        return synthesize(image, np.full_like(depth, level), RECIPE).astype(np.int64)

    for level, part in ((200, np.s_[:, :12]), (255, np.s_[:, 12:])):
        seen = []
        for step in STEPS:
            # Beyond level 255 there is none: at the end of the scale the farther side decides.
            sides = [level + move for move in (-step, step) if 0 <= level + move <= 255]
            changes = [np.abs(stored(side) - stored(level)).max(axis=2) for side in sides]
            seen.append((np.min(changes, axis=0) > noise)[part])
        by_hand = np.where(np.any(seen, axis=0), np.array(STEPS)[np.argmax(seen, axis=0)], UNSEEN)
        assert (found.step[part] == by_hand).all()


def test_a_median_is_a_step_that_occurs_or_none() -> None:
    valid = np.ones((1, 4), bool)
    steps = np.array([[1, 128, 256, 256]])
    assert median_step([Difficulty(steps, valid)]) == 128
    assert median_step([Difficulty(steps, valid), Difficulty(steps + 256, valid)]) == UNSEEN
    assert median_step([Difficulty(steps, ~valid)]) is None


@settings(max_examples=10, deadline=None)
@given(st.floats(0.05, 0.9), st.integers(0, 100))
def test_less_contrast_and_more_noise_make_it_harder(contrast: float, seed: int) -> None:
    depth = np.random.default_rng(seed).integers(1, 256, (24, 24)).astype(np.uint8)
    image = texture(contrast, seed)
    quiet, noisy = (smallest_step(image, depth, depth > 0, RECIPE, noise) for noise in (0, 4))
    assert (quiet.step <= noisy.step).all()
    darker = smallest_step(texture(contrast / 8, seed), depth, depth > 0, RECIPE)
    assert darker.share_above(8) >= quiet.share_above(8)


def test_only_known_pixels_count() -> None:
    image = texture(1)
    image[:, :12] = 128
    depth = np.full((24, 24), 250, np.uint8)
    valid = np.zeros((24, 24), bool)
    valid[:, 18:] = True
    step = median_step([smallest_step(image, depth, valid, RECIPE)])
    assert step is not None
    assert step <= 2
    assert math.isnan(smallest_step(image, depth, ~(depth > 0), RECIPE).share_above(1))


@pytest.mark.slow
def test_the_errors_of_local_follow_it(demo_store: Dataset) -> None:
    # Both views of one test scene under every light: the shares rank the errors, and pixels
    # whose blur shows only larger steps err more.
    predict, steps, errors, shares, means = Local(RECIPE), [], [], [], []
    for pair in demo_store.pairs("Market")[:9]:
        images = demo_store.read(pair)
        found = smallest_step(images.infocus, images.levels, images.valid, RECIPE)
        error = np.abs(predict(images.infocus, images.defocus) - images.depth)[images.valid]
        steps.append(found.step[images.valid])
        errors.append(error)
        shares.append(found.share_above(8))
        means.append(error.mean())
    assert spearmanr(shares, means).statistic > 0.8
    step, error = np.concatenate(steps), np.concatenate(errors)
    by_step = [error[step == value].mean() for value in (4, 32, 128, UNSEEN)]
    assert by_step == sorted(by_step)


def of(*steps: int, known: bool = True) -> Difficulty:
    return Difficulty(np.array([steps]), np.full((1, len(steps)), known))


def rows(manifest: Manifest) -> list[dict[str, object]]:
    found: dict[Pair, Difficulty] = {}
    for pair in manifest.pairs("train"):
        # View 5 is harder than view 1, and exposure 0 shows nothing.
        shown = of(1, 1, 2, 64) if pair.at["view"] == 1 else of(64, 64, 64, 128)
        found[pair] = of(*[UNSEEN] * 4) if pair.at["exposure"] == 0 else shown
    for pair in manifest.pairs("K2"):
        found[pair] = of(1, known=False)
    return difficulty_rows(manifest, found)


def test_a_row_takes_the_views_of_a_lighting_together(tiny_manifest: Manifest) -> None:
    dark, bright = rows(tiny_manifest)[:2]
    assert (dark["scene"], dark["exposure"], bright["exposure"]) == ("One", 0, 1)
    assert (dark["neighbours"], dark["coarse"], dark["median_step"]) == (1.0, 1.0, UNSEEN)
    # Means over both views of 2 of 4 and 4 of 4, of 1 of 4 and 4 of 4; the fourth of 8 steps.
    assert (bright["neighbours"], bright["coarse"], bright["median_step"]) == (0.75, 0.625, 64)


def test_json_has_numbers_and_null_where_there_is_none(tiny_manifest: Manifest) -> None:
    content = json.loads(difficulty_as_json(tiny_manifest, "f" * 64, 3, rows(tiny_manifest)))
    assert (content["dataset"], content["noise"]) == ("tiny-1", 3)
    dark, bright, unknown = content["rows"][:3]
    assert (dark["neighbours"], dark["median_step"]) == (1.0, None)
    assert bright["median_step"] == 64
    assert (unknown["neighbours"], unknown["coarse"], unknown["median_step"]) == (None, None, None)


def test_a_flat_image_shows_no_step_and_strong_texture_shows_small_ones() -> None:
    depth = np.full((24, 24), 120, np.uint8)
    flat = smallest_step(texture(0), depth, depth > 0, RECIPE)
    assert (flat.step == UNSEEN).all()
    assert (flat.share_above(1), flat.share_above(UNSEEN)) == (1.0, 0.0)
    near = np.full((24, 24), 250, np.uint8)
    step = median_step([smallest_step(texture(1), near, near > 0, RECIPE)])
    assert step is not None
    assert step <= 2
