"""stack-net: made stacks of any length, size and order, and what it refuses."""

import numpy as np
import pytest

from dfdbench.errors import MethodError
from tests.made_stacks import made_capture, stack_of, wall
from tests.methods.made_planes import texture

pytest.importorskip("torch")

from dfdbench.methods.stack_net import StackNetMethod

FOCUS = (30.0, 75.0, 120.0, 165.0, 210.0)
METHOD = StackNetMethod(device="cpu")


@pytest.mark.parametrize("count", [3, 4, 10])
def test_finds_a_plane_in_any_number_of_images(count: int) -> None:
    focus = tuple(np.linspace(30, 210, count).tolist())
    for level in (60, 150):
        depth, sigma = METHOD(stack_of(wall(level, focus, 0.03, (96, 128)), focus))
        assert depth.shape == sigma.shape == (96, 128)
        assert depth.dtype == sigma.dtype == np.float32
        assert np.median(np.abs(depth - level)) < 90 / (count - 1)


def test_the_order_of_images_their_bits_and_the_one_in_focus_change_nothing() -> None:
    capture = made_capture(focus=FOCUS)
    depth, sigma = METHOD(capture.stack)
    mixed = capture.stack.isel(image=[3, 0, 5, 1, 4, 2])
    without = made_capture(focus=FOCUS, with_infocus=False).stack
    for other in (mixed, without):
        again = METHOD(other)
        np.testing.assert_array_equal(again[0], depth)
        np.testing.assert_array_equal(again[1], sigma)
    deep, _ = METHOD(capture.stack.astype(np.uint16) * 257)
    np.testing.assert_allclose(deep, depth, atol=0.1)


def test_answers_in_metres_by_inverse_distance() -> None:
    metres = np.array([0.5, 0.6, 0.8, 1.2, 3.0])
    images = wall(1 / 0.9, (1 / metres).tolist(), 2.5, (96, 128))
    stack = stack_of(images, metres.tolist(), unit="metres", ends=(0.4, 5.0))
    depth, sigma = METHOD(stack)
    assert np.median(np.abs(depth - 0.9)) < 0.1
    assert sigma.min() > 0
    alone = StackNetMethod(sure=False, device="cpu")(stack)
    np.testing.assert_array_equal(alone, depth)


@pytest.mark.parametrize("shape", [(1, 1), (3, 70), (33, 47)])
def test_any_size_has_an_answer_within_the_range(shape: tuple[int, int]) -> None:
    random = np.random.default_rng(0)
    images = [random.integers(0, 256, (*shape, 3)).astype(np.uint8) for _ in FOCUS]
    depth, sigma = METHOD(stack_of(images, FOCUS))
    assert depth.shape == shape
    assert depth.min() >= 0
    assert depth.max() <= 255
    assert np.isfinite(sigma).all()
    assert sigma.min() > 0


def test_says_whose_stack_is_wrong() -> None:
    with pytest.raises(MethodError, match=r"\(stack-net\): expected 3 or more, got 1"):
        METHOD(stack_of([texture(0)], (30.0,)))
