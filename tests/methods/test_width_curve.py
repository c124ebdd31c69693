"""The curve of widths, held against residuals whose least value is known."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import MethodError
from dfdbench.methods import width_curve

LEVEL = np.arange(LEVELS)
LINE = 0.4 + 0.01 * LEVEL
# A lens that focuses inside the range.
VALLEY = np.hypot(0.5, 0.014 * (LEVEL - 140))
PIXELS = np.full(LEVELS, 1000)


def test_the_curve_is_what_the_normal_equations_say() -> None:
    random = np.random.default_rng(1)
    weights = random.random(LEVELS) * (random.random(LEVELS) < 0.6)
    values = LINE + 0.1 * random.normal(size=LEVELS)
    bends = np.diff(np.eye(LEVELS), 2, axis=0)
    dense = np.linalg.solve(np.diag(weights) + 40 * bends.T @ bends, weights * values)
    assert_allclose(width_curve.smooth_curve(values, weights, 40.0)[0], dense, rtol=1e-10)


def test_where_every_width_leaves_as_much_nothing_is_made_up() -> None:
    with pytest.raises(MethodError, match="do not show"):
        width_curve.width_curve(np.full((LEVELS, width_curve.LADDER.size), 100.0), PIXELS)
    with pytest.raises(MethodError, match="do not show"):
        width_curve.width_curve(np.zeros((LEVELS, width_curve.LADDER.size)), np.zeros(LEVELS, int))
    # One depth shows its width, but not how the width changes.
    sums = np.square(np.subtract.outer(LINE, width_curve.LADDER)) * 1e4
    with pytest.raises(MethodError, match="do not show"):
        width_curve.width_curve(np.where(LEVEL[:, None] == 90, sums, 0), 1000 * (LEVEL == 90))


def test_ends_that_nobody_saw_do_not_come_back_to_the_widths_of_others() -> None:
    pixels = np.where((LEVEL >= 40) & (LEVEL <= 200), 9, 0)
    # What goes on beyond all that was seen is left alone.
    assert_allclose(width_curve.held_at_ends(LINE, pixels), LINE)
    bent = LINE.copy()
    bent[:60] = LINE[60] + (LINE[60] - LINE[:60])
    held = width_curve.held_at_ends(bent, pixels)
    assert_allclose(held[40:], bent[40:])
    assert_allclose(held[:40], bent[40])
    # A lens that focuses inside the range, seen on one side of the focus more than on the other.
    held = width_curve.held_at_ends(VALLEY, pixels)
    assert_allclose(held[200:], VALLEY[200])
    assert_allclose(held[:201], VALLEY[:201])


def test_a_curve_turns_back_only_where_few_pixels_tell_and_a_lens_could_not() -> None:
    few = np.where(LEVEL > 208, 2, 9)
    # Blur is not measured beyond the ladder: both sides of a focus may end there, as wide.
    both = np.minimum(0.5 + 0.1 * np.abs(LEVEL - 128), width_curve.LADDER[-1])
    # Beside jumps of depth little tells the widest blurs: some came out as none.
    for curve in (LINE, both):
        grown = width_curve.grown_from_focus(np.where(LEVEL > 216, 0.3, curve), few)
        assert_allclose(grown, curve)
    # A focus inside the range, and what noise does, stay as they are.
    wavy = VALLEY * (1 + 0.03 * np.sin(LEVEL))
    assert_allclose(width_curve.grown_from_focus(wavy, few), wavy)


def test_noise_near_a_focus_at_the_far_end_does_not_make_that_end_grow() -> None:
    # Few pixels are so far; before them noise bends the curve up and down again.
    curve = np.maximum(0.42, 0.42 + 0.006 * (LEVEL - 56))
    curve += 0.1 * np.exp(-np.square((LEVEL - 45) / 6))
    pixels = np.where(LEVEL < 40, 100, 1000)
    assert_allclose(width_curve.grown_from_focus(curve, pixels), curve)
    # It is no noise if the widths had grown sevenfold, however many levels are rare.
    whole = np.minimum(0.45 + 0.04 * np.abs(LEVEL - 100), width_curve.LADDER[-1])
    back = np.where(LEVEL > 170, 0.6, whole)
    found = width_curve.grown_from_focus(back, np.where(LEVEL > 170, 30, 3000))
    assert_allclose(found, whole)


def bowls(widths: NDArray[Any]) -> NDArray[np.float64]:
    """Squared differences of 1,000 pixels a level: least at a width, and rounding's there."""
    away = width_curve.LADDER[np.newaxis, :] - widths[:, np.newaxis]
    return np.asarray(1000 * (1 / 12 + 30 * away**2))


@pytest.mark.parametrize("widths", [LINE, VALLEY], ids=["line", "valley"])
def test_the_widths_of_least_difference_are_found(widths: NDArray[Any]) -> None:
    found, sharpness, least = width_curve.best_widths(bowls(widths))
    assert_allclose(found, widths, atol=0.05)
    assert (sharpness > 0).all()
    assert (least >= 0).all()
    assert_allclose(width_curve.width_curve(bowls(widths), PIXELS), widths, atol=0.06)
    assert_allclose(width_curve.left_at(bowls(widths), widths), 1000 / 12, rtol=0.2)


def test_levels_that_training_lacks_lie_between_their_neighbours() -> None:
    sums, pixels = bowls(LINE), PIXELS.copy()
    pixels[100:140] = 0
    sums[100:140] = 0
    assert_allclose(width_curve.width_curve(sums, pixels)[100:140], LINE[100:140], atol=0.06)
