"""Solvers on focal stacks: what is fitted, without an image in focus too, what is refused."""

import tracemalloc
from copy import copy
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.errors import MethodError
from dfdbench.methods.calibration import calibrate_images
from dfdbench.methods.method import Learned, check_learned
from dfdbench.methods.registry import load
from dfdbench.methods.stacks import farther_is_higher, sharp_and_blurred
from tests.made_stacks import made_capture, stack_of
from tests.methods.made_planes import texture

FOCUS = (30, 90, 150, 210)
SOLVERS = ("graph-cuts", "graph-cuts-rounded", "sgm", "guided", "local")


@cache
def learned(with_infocus: bool) -> Learned:
    """Return what a solver learns of two made stacks, once for all tests."""
    method: Any = load("sgm")
    captures = [made_capture(seed, FOCUS, with_infocus=with_infocus) for seed in (1, 2)]
    return check_learned(method.fit(captures), "sgm")


def error_of(depth: Any, capture: Any) -> float:
    return float(np.abs(depth - capture.depth)[12:-12, 12:-12].mean())


@pytest.mark.slow
@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("with_infocus", [True, False])
def test_solves_a_stack_after_a_fit(name: str, with_infocus: bool) -> None:
    method: Any = load(name, recipe=None)
    method.restore(learned(with_infocus))
    method.warm_up(texture(0), texture(0))
    capture = made_capture(7, FOCUS, with_infocus=with_infocus)
    assert error_of(method.from_stack(capture.stack), capture) < (3 if with_infocus else 6)


@pytest.mark.slow
def test_a_fit_learns_that_levels_grow_with_distance() -> None:
    capture = made_capture(1, FOCUS)
    capture.levels = capture.depth = 255 - capture.levels
    capture.stack.attrs |= {"near": 0.0, "far": 255.0}
    method: Any = load("sgm")
    assert method.fit([capture])["farther_is_higher"]
    assert "farther_is_higher" not in learned(with_infocus=True)


@pytest.mark.parametrize("farther", [False, True])
def test_levels_of_metres_tell_by_the_depth_which_way_they_go(farther: bool) -> None:
    ends: dict[str, Any] = {"near_level": 1, "far_level": 255} if farther else {}
    scale = DepthScale(near=0.5, far=5.0, **ends)
    capture = made_capture(1, FOCUS)
    capture.depth = np.linspace(1, 4, capture.levels.size).reshape(capture.levels.shape)
    capture.levels = scale.to_levels(capture.depth)
    capture.stack.attrs |= {"unit": "metres", "near": 0.5, "far": 5.0}
    flat = copy(capture)
    flat.levels = np.full_like(capture.levels, 9)
    assert farther_is_higher([flat, capture]) is farther
    assert farther_is_higher([flat]) is False


@pytest.mark.slow
def test_local_does_not_hold_all_of_a_stack_blurred() -> None:
    many = {name: np.repeat(value, 6, axis=0) for name, value in learned(True).items()}
    method: Any = load("local", recipe=None)
    method.restore(many)
    image = texture(0, 128, 160)
    stack = stack_of([image] * 24, np.repeat(FOCUS, 6).tolist(), infocus=image)
    method.warm_up(image, image)
    tracemalloc.start()
    method.from_stack(stack)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # The costs of all levels, of 16 bits, are half of it.
    assert peak < 2 * 2 * 256 * image.shape[0] * image.shape[1]


@pytest.mark.slow
def test_a_stack_of_other_images_is_refused() -> None:
    method: Any = load("guided", recipe=None)
    method.restore(learned(with_infocus=True))
    stack = made_capture(7, FOCUS).stack
    with pytest.raises(MethodError, match="3 defocus images, but the blur is known of 4"):
        method.from_stack(stack.isel(image=[0, 1, 2, 3]))
    with pytest.raises(MethodError, match="1 defocus images, but the blur is known of 4"):
        method(texture(0), texture(0))


def test_a_stack_needs_a_fit_whatever_the_recipe() -> None:
    method: Any = load("sgm", recipe="published")
    with pytest.raises(MethodError, match="leave recipe out"):
        method.from_stack(made_capture(0, FOCUS).stack)


def test_training_stacks_have_to_be_focused_alike_and_of_one_aperture() -> None:
    captures = [made_capture(seed, FOCUS) for seed in (0, 1)]
    for other in ((30, 90, 150, 220), FOCUS[:3]):
        with pytest.raises(MethodError, match="not focused alike"):
            calibrate_images([captures[0], made_capture(1, other)])
    for capture, number in zip(captures, (2.8, 4), strict=True):
        capture.stack = capture.stack.assign_coords(f_number=("image", [16.0] + [number] * 4))
    # Every fifth is of another aperture, which captures evenly among all would miss.
    for mixed in (captures, [captures[number % 5 == 3] for number in range(80)]):
        with pytest.raises(MethodError, match="not taken at one aperture"):
            calibrate_images(mixed)


def test_favaro_and_soatto_take_any_number_of_images() -> None:
    errors = []
    for focus in (FOCUS[:1], FOCUS[::2]):
        method: Any = load("favaro-soatto", groups=16, sharp_patch=11)
        training = [made_capture(seed, focus) for seed in (1, 2, 3)]
        method.restore(check_learned(method.fit(training), "favaro-soatto"))
        method.warm_up(texture(0), texture(0))
        capture = made_capture(7, focus)
        errors.append(error_of(method.from_stack(capture.stack), capture))
    assert errors[1] < min(errors[0], 12)
    with pytest.raises(MethodError, match="1 defocus images, but 2 were fitted"):
        method(texture(0), texture(0))
    with pytest.raises(MethodError, match="different numbers"):
        method.fit([training[0], made_capture(1, FOCUS)])


def test_an_image_that_others_are_sharper_than_is_not_in_focus() -> None:
    capture = made_capture(3, FOCUS)
    truth = capture.infocus.astype(float)
    far = capture.infocus.copy()
    far[40:] = cv2.GaussianBlur(far, (0, 0), 1.0)[40:]
    stack = stack_of(capture.stack.values[1:], FOCUS, infocus=far)
    sharp, _ = sharp_and_blurred(stack)
    assert np.abs(sharp - truth).mean() < 0.6 * np.abs(far - truth).mean()
    # Of a pair there is nothing sharper to be found.
    np.testing.assert_array_equal(sharp_and_blurred(stack[:2])[0], far)


@pytest.mark.slow
@pytest.mark.parametrize("with_infocus", [True, False])
def test_a_stack_that_breathes_is_put_together_in_one_view(with_infocus: bool) -> None:
    growths = [0.0, -0.01, -0.02, -0.03] if with_infocus else [0.02, 0.01, 0.0, -0.01]
    captures = [made_capture(seed, FOCUS, with_infocus=with_infocus) for seed in range(3)]
    for capture in captures:
        for image, growth in zip(capture.stack.values[-4:], growths, strict=True):
            image[:] = zoomed(image, growth)
        if with_infocus:  # not quite
            capture.stack.values[0] = cv2.GaussianBlur(capture.infocus, (0, 0), 1.0)
    found = calibrate_images(captures)
    assert [law.law.similarity[3] for law in found] == pytest.approx(growths, abs=3e-3)
    for capture in captures:
        off = [
            np.abs(sharp_and_blurred(capture.stack, changes)[0].astype(float) - capture.infocus)
            for changes in ([each.change for each in found], [])
        ]
        told, untold = (each[12:-12, 12:-12].mean() for each in off)
        assert told < 0.6 * untold


def zoomed(image: Any, growth: float) -> Any:
    """Return an image as much larger about its middle, by OpenCV."""
    height, width = image.shape[:2]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), 0, 1 + growth)
    how: Any = {"flags": cv2.INTER_CUBIC, "borderMode": cv2.BORDER_REPLICATE}
    return cv2.warpAffine(image, matrix, (width, height), **how)


def test_an_image_in_focus_is_put_together_and_sixteen_bits_are_solved_as_eight() -> None:
    capture = made_capture(3, FOCUS)
    sharp, blurred = sharp_and_blurred(capture.stack)
    np.testing.assert_array_equal(sharp, capture.infocus)
    assert len(blurred) == 4
    made = sharp_and_blurred(made_capture(3, FOCUS, with_infocus=False).stack)[0]
    errors = [np.abs(image.astype(float) - sharp).mean() for image in (made, *blurred)]
    assert errors[0] < 0.4 * min(errors[1:])
    deep = sharp_and_blurred(capture.stack.astype(np.uint16) * 257)
    for one, other in zip((sharp, *blurred), (deep[0], *deep[1]), strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(MethodError, match="no image of the stack has the role defocus"):
        sharp_and_blurred(stack_of([], (), texture(0)))
