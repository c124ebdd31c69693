import json
import math
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from dfdbench.audit.difficulty import (
    STEPS,
    UNSEEN,
    WINDOWS,
    Bound,
    Difficulty,
    bound_of,
    bound_table,
    difficulty_as_json,
    difficulty_rows,
    median_step,
    smallest_step,
)
from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.datasets.captures import LEVELS, Capture
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Depth, Manifest, Pair
from dfdbench.methods.baselines import Local
from dfdbench.methods.calibration import calibrate
from tests.made_results import limited, make_demo_result

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


Floats = NDArray[np.float64]
SIGMAS = np.linspace(3.0, 0.6, 64)
LEVEL = 30
SIDE = 31


def noisy_grey(contrast: float) -> NDArray[np.uint8]:
    grey = np.random.default_rng(3).normal(128, contrast, (SIDE, SIDE, 3))
    return np.clip(grey, 0, 255).astype(np.uint8)


def looks(infocus: NDArray[np.uint8], levels: Floats, window: int) -> Floats:
    """Return the middle of the image blurred at levels between whole ones: (level, value)."""
    at, low = SIDE // 2, SIDE // 2 - window // 2
    inner = np.s_[low : low + window, low : low + window] if window > 1 else np.s_[at, at]
    sharp = infocus.astype(float)
    blurred = [
        gaussian_filter(sharp, (sigma, sigma, 0), mode="nearest", radius=(13, 13, 0))
        for sigma in np.interp(levels, np.arange(64), SIGMAS)
    ]
    return np.stack([image[inner].ravel() for image in blurred])


def looked_at(
    infocus: NDArray[np.uint8],
    spread: float,
    noise: float,
    infocus_noise: float = 0.0,
    about: Depth = LEVELS,
) -> Bound:
    law = BlurLaw(tuple(SIGMAS), noise=(noise,), infocus_noise=infocus_noise)
    level = np.full(infocus.shape[:2], LEVEL, np.float32)
    depth = about.of_unit(level, "levels")
    capture = Capture(Pair("One", ()), np.stack([infocus] * 2), depth, about=about)
    return bound_of(law, capture, spread)


def least(bound: Bound, window: int) -> float:
    return float(bound.least_error(window)[SIDE // 2, SIDE // 2])


def most_likely(values: Floats, shown: Floats, levels: Floats) -> Floats:
    """Return the level of least squares of each draw, to a fraction of the grid's step."""
    squares = np.square(shown).sum(axis=1) - 2 * values @ shown.T
    at = np.clip(squares.argmin(axis=1), 1, len(levels) - 2)
    before, here, after = (squares[np.arange(len(at)), at + step] for step in (-1, 0, 1))
    fraction = (before - after) / (2 * (before + after - 2 * here))
    return np.asarray(levels[at] + (levels[1] - levels[0]) * fraction)


def test_the_likeliest_level_errs_as_the_bound_says() -> None:
    for noise, contrast, window in ((0.3, 60, 1), (1.0, 40, 7), (4.0, 60, 7), (1.0, 5, 21)):
        infocus = noisy_grey(contrast)
        wanted = least(looked_at(infocus, 1e6, noise=noise), window)
        levels = np.linspace(LEVEL - 6 * wanted, LEVEL + 6 * wanted, 121)
        shown = looks(infocus, levels, window)
        true = looks(infocus, np.array([float(LEVEL)]), window)
        values = true + np.random.default_rng(0).normal(0, noise, (4000, true.size))
        assert most_likely(values, shown, levels).std() == pytest.approx(wanted, rel=0.05)


def test_noise_of_the_infocus_image_counts_as_much_as_blur_leaves_of_it() -> None:
    infocus, noise = noisy_grey(60), 0.5
    wanted = least(looked_at(infocus, 1e6, noise=noise, infocus_noise=1.0), 1)
    levels = np.linspace(LEVEL - 6 * wanted, LEVEL + 6 * wanted, 121)
    shown = looks(infocus, levels, 1)
    random = np.random.default_rng(0)
    sigma = SIGMAS[LEVEL]
    errors = []
    for _ in range(3000):
        # What the method sees as sharp has noise, which the true one had not.
        seen = random.normal(0, noise, (13, 13, 3))
        errors.append(gaussian_filter(seen, (sigma, sigma, 0))[6, 6] + random.normal(0, noise, 3))
    values = looks(infocus, np.array([float(LEVEL)]), 1) + np.stack(errors)
    assert most_likely(values, shown, levels).std() == pytest.approx(wanted, rel=0.06)


def test_in_metres_a_level_counts_as_far_as_it_reaches() -> None:
    scale = DepthScale(near=0.5, far=4.0)
    about = LEVELS.model_copy(update={"unit": "metres", "scale": scale})
    given = noisy_grey(10), 1e6, 2.0, 0.0
    # From z = 1 / (1/far + (level - 1) (1/near - 1/far) / 254), in 255ths of far - near.
    rate = (1 / 0.5 - 1 / 4.0) / 254
    reach = rate / (1 / 4.0 + (LEVEL - 1) * rate) ** 2 * 255 / 3.5
    ratio = least(looked_at(*given, about=about), 7) / least(looked_at(*given), 7)
    assert ratio == pytest.approx(reach, rel=1e-3)


def test_what_is_known_before_is_weighed_as_bayes_does() -> None:
    infocus, noise, window = noisy_grey(20), 8.0, 7
    alone = least(looked_at(infocus, 1e6, noise=noise), window)
    spread = 0.7 * alone
    random = np.random.default_rng(0)
    truth = random.normal(LEVEL, spread, 1500)
    values = looks(infocus, truth, window)
    values += random.normal(0, noise, values.shape)
    levels = np.linspace(LEVEL - 5 * spread, LEVEL + 5 * spread, 81)
    shown = looks(infocus, levels, window)
    nats = values @ shown.T / noise**2 - np.square(shown).sum(axis=1) / (2 * noise**2)
    nats -= np.square(levels - LEVEL) / (2 * spread**2)
    weights = np.exp(nats - nats.max(axis=1, keepdims=True))
    mean = (weights @ levels) / weights.sum(axis=1)
    error = math.sqrt(np.square(mean - truth).mean())
    assert error == pytest.approx(least(looked_at(infocus, spread, noise=noise), window), rel=0.06)
    assert error < 0.8 * alone


def test_without_texture_or_depth_nothing_is_told() -> None:
    flat = looked_at(np.full((SIDE, SIDE, 3), 90, np.uint8), 20.0, noise=1.0)
    assert flat.least_error(21) == pytest.approx(20.0, rel=1e-4)
    assert flat.nrmse == pytest.approx(dict.fromkeys(WINDOWS, 20 / 255), rel=1e-4)
    unknown = Bound(np.zeros((3, 3)), np.zeros((3, 3), bool), 20.0)
    assert all(map(math.isnan, unknown.nrmse.values()))


def test_a_wider_window_never_tells_less() -> None:
    bound = looked_at(noisy_grey(10), 40.0, noise=2.0)
    maps = [bound.least_error(window) for window in WINDOWS]
    assert all((wide <= narrow + 1e-9).all() for narrow, wide in pairwise(maps))
    assert list(bound.nrmse.values()) == sorted(bound.nrmse.values(), reverse=True)


def test_a_table_sets_runs_beside_the_bound_and_leaves_out_those_without_scores() -> None:
    manifest = find_manifest("demo")
    told = np.full((4, 6), 1 / 60.0)
    found = {pair: Bound(told, told > 0, 40.0) for pair in manifest.pairs("test")}
    runs = {
        # Root mean squares over captures: of 0 and the square root of 8.
        "twice": make_demo_result(
            lambda pair: math.sqrt(8) * found[pair].nrmse[1] * (pair.at["view"] == 1),
            protocols=("valid",),
        ),
        "half": make_demo_result(lambda pair: found[pair].nrmse[1] / 2, protocols=("valid",)),
        "thesis": make_demo_result(lambda pair: 0.1, protocols=("thesis",)),
    }
    runs["stopped"] = limited(runs["twice"], 3)
    table = bound_table(manifest, "test", found, runs)
    one = next(iter(found.values())).nrmse[1]
    assert [row[:3] for row in table.rows] == [
        ("least error", "–", f"{one:.4f}"),
        ("half", f"{one / 2:.4f}", "2.00"),
        ("twice", f"{2 * one:.4f}", "0.50"),
    ]
    assert table.notes[-1].endswith("left out: thesis, stopped")
    alone = bound_table(manifest, "test", found, {})
    assert [row[:2] for row in alone.rows] == [("least error", f"{one:.4f}")]
    assert not any("run" in note for note in alone.notes)
    assert "of any method that judges a pixel" in table.notes[0]
    # Of a stack, the bound sees two images, and a run may see more.
    stacks = manifest.model_copy(update={"pair_images": [0, 2]})
    notes = bound_table(stacks, "test", found, runs).notes
    assert "is given the two images pair_images = [0, 2] alone and judges" in notes[0]
    assert notes[2].startswith("above 1: the run is given more images, looks farther")


@pytest.mark.slow
def test_local_comes_near_its_bound_away_from_rims(demo_store: Dataset) -> None:
    law = calibrate(demo_store.captures("train")).law
    predict, square = Local(RECIPES["published"]), np.ones((7, 7), np.uint8)
    sums = np.zeros((3, 2))
    pixels = []
    for capture in demo_store.captures("test")[::9]:
        off = predict(capture.infocus, capture.defocus) - capture.levels.astype(np.float64)
        bound = bound_of(law, capture, 40.0).least_error(7)
        span = cv2.dilate(capture.levels, square).astype(int) - cv2.erode(capture.levels, square)
        unknown = cv2.dilate((~capture.valid).astype(np.uint8), square) > 0
        rim = (span > 8) | unknown
        far = ~rim & ((np.abs(off) > 4 * bound) | (bound > 16))
        for total, part in zip(sums, (rim, far, ~rim & ~far), strict=True):
            part &= capture.valid
            total += np.square(off)[part].sum(), np.square(bound)[part].sum()
        pixels.append((~rim & ~far).sum() / capture.valid.sum())
    assert sums[0, 0] > 0.55 * sums[:, 0].sum()
    assert np.mean(pixels) > 0.85
    assert 1 < math.sqrt(sums[2, 0] / sums[2, 1]) < 1.34
