"""What is asked of every method that is told the blur or fitted to it."""

from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES
from dfdbench.errors import MethodError
from dfdbench.evaluation.check import made_pair
from dfdbench.methods.fitted import depth_table, learned_array
from dfdbench.methods.method import Predict, restore, teach
from dfdbench.methods.registry import load, load_method
from tests.methods.made_planes import inside, plane, slope, texture

NAMES = ["favaro-soatto", "guided", "rational-filters", "s-transform", "sgm", "wls"]
LEARNED = ("favaro-soatto", "wls")
READY = [*NAMES, "graph-cuts", "graph-cuts-rounded"]


@cache
def ready(name: str) -> Predict:
    """Return the method, told the blur, or fitted where it takes no recipe."""
    if name not in LEARNED:
        return load(name, recipe=RECIPES["published"])
    method = load_method(name, {}, {})
    teach(method, [slope(seed) for seed in range(2)])
    return method.predict


def test_a_plane_is_found() -> None:
    for name, errors in (
        ("guided", (1.5, 1.5, 1.5)),
        ("sgm", (1, 1, 1)),
        ("rational-filters", (8, 8, 8)),
        ("favaro-soatto", (5, 5, 5)),
        # The larger the blur, the less it is a matter of the Laplacian alone.
        ("s-transform", (16, 2, 6)),
        ("wls", (8, 3, 8)),
    ):
        for level, error in zip((20, 120, 240), errors, strict=True):
            pair = plane(level, seed=50)
            found = inside(ready(name)(pair.infocus, pair.defocus))
            assert np.abs(found - level).mean() < error, (name, level)


def test_wrong_parameters_are_all_named() -> None:
    wrong_ones: list[tuple[str, dict[str, Any]]] = [
        ("constant", {"training_mean": 300}),
        ("local", {"prior": "yes", "window": 2.5}),
        ("guided", {"prior": "yes", "window": 6, "flatness": -1, "limit": 0}),
        ("sgm", {"small_step": 0, "large_step": 1e9, "limit": 0}),
        ("graph-cuts", {"prior": "yes"}),
        ("s-transform", {"smoothing": 0, "window": 4, "sure": "very"}),
        ("rational-filters", {"prior": "yes", "window": -3}),
        ("wls", {"contrast": 0}),
        ("favaro-soatto", {"sharp_patch": 4, "blurred_patch": 0, "groups": 1, "window": 2}),
    ]
    for name, wrong in wrong_ones:
        with pytest.raises(MethodError) as caught:
            load(name, **wrong)
        assert [problem.where for problem in caught.value.problems] == list(wrong)


@pytest.mark.parametrize("name", READY)
@pytest.mark.parametrize("shape", [(1, 1), (3, 2), (33, 47), (40, 7)])
def test_any_size_with_texture_or_none_gives_a_depth_map(name: str, shape: tuple[int, int]) -> None:
    for image in (texture(3, *shape), *(np.full((*shape, 3), grey, np.uint8) for grey in (0, 255))):
        found = ready(name)(image, image)
        assert (found.shape, found.dtype) == (shape, np.float32)
        assert np.isfinite(found).all()
        assert 0 <= found.min() <= found.max() <= 255


@pytest.mark.parametrize("name", READY)
def test_a_grey_image_counts_as_much_as_three_equal_channels(name: str) -> None:
    pair = slope(1, 40, 60)
    three = [np.repeat(image[..., :1], 3, axis=2) for image in (pair.infocus, pair.defocus)]
    one = [image[..., 0].copy() for image in (pair.infocus, pair.defocus)]
    method = ready(name)
    first, second = method(*three), method(*one)
    assert second.shape == (40, 60)
    assert np.abs(first - second).mean() < 6


@pytest.mark.parametrize("name", READY)
def test_the_number_of_threads_changes_no_byte(name: str) -> None:
    pair = slope(2, 70, 90)
    method = ready(name)
    before = cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        alone = method(pair.infocus, pair.defocus)
        cv2.setNumThreads(2)
        together = method(pair.infocus, pair.defocus)
    finally:
        cv2.setNumThreads(before)
    assert alone.tobytes() == together.tobytes()


# The others learn a blur law: `tests/methods/test_calibration.py`.
@pytest.mark.parametrize("name", [*LEARNED, "s-transform"])
def test_what_is_learned_is_all_that_is_needed_and_the_same_each_time(name: str) -> None:
    pairs = [slope(seed) for seed in range(2)]
    first, other = load_method(name, {}, {}), load_method(name, {}, {})
    learned = teach(first, pairs)[0]
    assert learned is not None
    again = teach(other, pairs)[0] or {}
    assert again.keys() == learned.keys()
    assert all(np.array_equal(again[key], value) for key, value in learned.items())
    fresh = load_method(name, {}, {})
    restore(fresh, learned)
    pair = slope(7, 40, 60)
    found = [method.predict(pair.infocus, pair.defocus) for method in (first, fresh)]
    assert np.array_equal(*found)


@pytest.mark.parametrize("name", NAMES)
def test_without_a_fit_or_fitted_to_nothing_it_says_what_to_do(name: str) -> None:
    pair, method = slope(1, 40, 60), load_method(name, {}, {})
    with pytest.raises(MethodError, match=r"call fit\(captures\)"):
        method.predict(pair.infocus, pair.defocus)
    with pytest.raises(MethodError, match=r"not what this method learns|does not take back"):
        restore(method, {"other": np.ones(3)})
    unknown = made_pair(pair.infocus, pair.defocus, pair.levels, np.zeros_like(pair.valid))
    for pairs in ([], [unknown]):
        with pytest.raises(MethodError, match=r"nothing to fit to|no pair|do not show"):
            method.fit(pairs)


def test_a_table_follows_a_curve_that_turns_and_leaves_unknown_pixels_out() -> None:
    random = np.random.default_rng(0)
    depth = random.integers(0, 256, (300, 300)).astype(np.uint8)
    valid = random.random((300, 300)) < 0.5
    depth[~valid] = 0
    infocus = np.abs(depth[..., np.newaxis].astype(int) - 100).astype(np.uint8)
    infocus[~valid] = 255
    pair = made_pair(infocus, infocus, depth, valid)
    table = depth_table(lambda sharp, _: sharp[..., 0].astype(float), [pair], "mine")
    measure, found = np.asarray(table["measure"]), np.asarray(table["depth"])
    assert measure.max() <= 155
    far = measure > 101
    np.testing.assert_allclose(found[far], measure[far] + 100, atol=2)


@pytest.mark.parametrize("value", [[[1.0]], [np.nan], []])
def test_an_array_of_another_shape_or_with_gaps_is_refused(value: Any) -> None:
    with pytest.raises(MethodError, match="mine: table"):
        learned_array({"table": np.array(value)}, "table", "mine", 1)


@pytest.mark.parametrize("name", ["guided", "rational-filters", "s-transform"])
def test_a_window_larger_than_the_image_is_refused(name: str) -> None:
    pair = plane(120)
    method = load(name, recipe="published", window=63)
    assert method(pair.infocus, pair.defocus).shape == (64, 80)
    if hasattr(method, "warm_up"):
        method.warm_up(pair.infocus, pair.defocus)
    with pytest.raises(MethodError, match="larger than the image, 255 of 64 x 80"):
        load(name, recipe="published", window=255)(pair.infocus, pair.defocus)
