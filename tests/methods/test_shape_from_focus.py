"""Shape from focus: exact places on made stacks, the shared stack, and what it refuses."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.errors import MethodError, UnknownNameError
from dfdbench.methods.shape_from_focus import MEASURES, ShapeFromFocus, focus_cells
from tests.made_stacks import antinous, made_capture, stack_of, wall
from tests.methods.made_planes import texture

FOCUS = (30.0, 90.0, 150.0, 210.0)


def error_of(depth: Any, truth: Any) -> float:
    """Return the median error away from the border."""
    return float(np.median(np.abs(depth - truth)[12:-12, 12:-12]))


@pytest.mark.parametrize("level", [60, 80, 104, 130])
def test_finds_a_plane_between_two_focus_depths(level: int) -> None:
    stack = stack_of(wall(level, FOCUS, 0.03), FOCUS)
    for measure in MEASURES:
        assert error_of(ShapeFromFocus(measure)(stack), level) < 3


def test_the_curve_of_defocus_is_nearer_than_a_gaussian() -> None:
    capture = made_capture(focus=FOCUS)
    errors = {
        peak: error_of(ShapeFromFocus(peak=peak)(capture.stack), capture.depth)
        for peak in ("defocus", "gaussian", "none")
    }
    assert errors["defocus"] < 2
    assert errors["defocus"] < 0.5 * errors["gaussian"] < 0.5 * errors["none"]


def test_focus_depths_may_come_in_any_order_and_the_image_in_focus_is_left_out() -> None:
    focus = (30.0, 70.0, 150.0, 180.0, 230.0)
    capture = made_capture(focus=focus)
    depth = ShapeFromFocus()(capture.stack)
    assert error_of(depth, capture.depth) < 3
    mixed = capture.stack.isel(image=[3, 0, 5, 1, 4, 2])
    without = made_capture(focus=focus, with_infocus=False).stack
    for other in (mixed, without):
        np.testing.assert_array_equal(ShapeFromFocus()(other), depth)


def test_answers_in_metres_by_inverse_distance() -> None:
    metres = np.array([0.5, 0.7, 1.2, 3.0])
    images = wall(1 / 0.9, (1 / metres).tolist(), 2.5)
    stack = stack_of(images, metres.tolist(), unit="metres", ends=(0.4, 5.0))
    assert error_of(ShapeFromFocus()(stack), 0.9) < 0.03


def test_a_focus_at_infinity_is_the_farthest_depth() -> None:
    images = wall(0.0, (2.0, 1.0, 0.0), 2.5)
    stack = stack_of(images, (0.5, 1.0, np.inf), unit="metres", ends=(0.4, 50.0))
    assert ShapeFromFocus(peak="none")(stack).max() == 50


def test_sixteen_bits_a_channel_and_grey_images_say_the_same() -> None:
    stack = made_capture(focus=FOCUS).stack
    depth = ShapeFromFocus()(stack)
    deep = ShapeFromFocus()(stack.astype(np.uint16) * 257)
    # The grey of 8 bits is rounded.
    assert np.median(np.abs(deep - depth)) < 1
    grey = stack.isel(channel=[0]).copy()
    same = stack.copy(data=np.repeat(grey.values, 3, 3))
    np.testing.assert_allclose(ShapeFromFocus()(grey), ShapeFromFocus()(same), atol=1e-3)


@pytest.mark.parametrize("shape", [(1, 1), (3, 70), (33, 47), (5, 4)])
def test_any_size_has_an_answer_within_the_range(shape: tuple[int, int]) -> None:
    random = np.random.default_rng(0)
    images = [random.integers(0, 256, (*shape, 3)).astype(np.uint8) for _ in FOCUS]
    depth = ShapeFromFocus()(stack_of(images, FOCUS))
    assert depth.shape == shape
    assert depth.min() >= 0
    assert depth.max() <= 255


def test_says_what_is_wrong_with_the_focus_depths_or_a_parameter() -> None:
    for focus, words in (
        ((30.0, np.nan, 150.0, np.nan), r"images \[1, 3\] of 4 have no known focus depth"),
        ((30.0, 90.0, 90.0, 210.0), r"the same focus depth: \[90.0\]"),
        ((30.0, 90.0), "3 or more"),
        ((30.0, np.nan), "needs a focal stack, and this is a pair"),
    ):
        with pytest.raises(MethodError, match=words):
            ShapeFromFocus()(stack_of([texture(0)] * len(focus), focus))
    stack = stack_of([texture(0)] * 3, (-1.0, 1.0, 2.0), unit="metres", ends=(0.5, 5))
    with pytest.raises(MethodError, match="above 0"):
        ShapeFromFocus()(stack)
    with pytest.raises(UnknownNameError, match="measure"):
        ShapeFromFocus(measure="sharpness")
    with pytest.raises(MethodError, match="window"):
        ShapeFromFocus(window=20)


def test_bands_of_rows_leave_no_seam() -> None:
    image = np.vstack([texture(number) for number in range(4)])[:158]
    for measure, (function, power) in MEASURES.items():
        whole = function(image.astype(np.float32).mean(2).round())
        cells = whole[:156, :64].reshape(39, 4, 16, 4).mean((1, 3))
        grey = image.mean(2).round().astype(np.uint8)[..., None]
        found = np.exp(power * focus_cells(grey, measure))
        np.testing.assert_allclose(found[:39, :16], cells + 0.01**power, rtol=1e-4)


def test_reaches_its_goal_on_refocused_views(shared_data: Path) -> None:
    folder = shared_data / "stacks" / "antinous"
    if not folder.is_dir():
        pytest.skip("no stack antinous among the shared data")
    stack, truth = antinous(folder)
    errors = np.abs(ShapeFromFocus()(stack) - truth)
    assert errors.mean() <= 0.025 * np.ptp(truth)
    assert np.median(errors) <= 0.04
