"""What is asked of every method that is told the blur or fitted to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES
from dfdbench.errors import MethodError
from dfdbench.methods.fitted import depth_table, evenly_spread, learned_array
from dfdbench.methods.registry import load
from tests.methods.made_planes import MadePair, slope, texture

NAMES = ["favaro-soatto", "guided", "s-transform", "sgm"]


@cache
def ready(name: str) -> Callable[..., Any]:
    """Return the method, told the blur, or fitted where it takes no recipe."""
    if name != "favaro-soatto":
        return load(name, recipe=RECIPES["published"])
    method: Any = load(name)
    method.restore(method.fit([slope(seed) for seed in range(2)]))
    return method


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (3, 2), (33, 47), (40, 7)])
def test_any_size_gives_a_depth_map(name: str, shape: tuple[int, int]) -> None:
    image = texture(3, *shape)
    found = ready(name)(image, image)
    assert (found.shape, found.dtype) == (shape, np.float32)
    assert np.isfinite(found).all()
    assert 0 <= found.min() <= found.max() <= 255


@pytest.mark.parametrize("name", NAMES)
def test_a_grey_image_counts_as_much_as_three_equal_channels(name: str) -> None:
    pair = slope(1, 40, 60)
    three = [np.repeat(image[..., :1], 3, axis=2) for image in (pair.infocus, pair.defocus)]
    one = [image[..., 0].copy() for image in (pair.infocus, pair.defocus)]
    method = ready(name)
    first, second = method(*three), method(*one)
    assert second.shape == (40, 60)
    assert np.abs(first - second).mean() < 6


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [0, 128, 255])
def test_an_image_without_texture_gives_levels(name: str, value: int) -> None:
    flat = np.full((20, 30, 3), value, np.uint8)
    found = ready(name)(flat, flat)
    assert np.isfinite(found).all()
    assert 0 <= found.min() <= found.max() <= 255


@pytest.mark.parametrize("name", NAMES)
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


# `sgm` learns what `guided` learns.
@pytest.mark.parametrize("name", [name for name in NAMES if name != "sgm"])
def test_what_is_learned_is_all_that_is_needed_and_the_same_each_time(name: str) -> None:
    pairs = [slope(seed) for seed in range(2)]
    first: Any = load(name)
    learned = first.fit(pairs)
    again = load(name).fit(pairs)  # type: ignore[attr-defined]
    assert same(learned, again)
    first.restore(learned)
    other: Any = load(name)
    other.restore({key: np.array(value) for key, value in learned.items()})
    pair = slope(7, 40, 60)
    assert np.array_equal(first(pair.infocus, pair.defocus), other(pair.infocus, pair.defocus))


def same(first: Mapping[str, Any], second: Mapping[str, Any]) -> bool:
    equal = (np.asarray(first[key]).tobytes() == np.asarray(second[key]).tobytes() for key in first)
    return set(first) == set(second) and all(equal)


@pytest.mark.parametrize("name", NAMES)
def test_neither_told_nor_fitted_says_what_to_do(name: str) -> None:
    image = texture(0, 20, 20)
    with pytest.raises(MethodError, match="restore"):
        load(name)(image, image)


@pytest.mark.parametrize("name", NAMES)
def test_pairs_of_unknown_depth_are_refused(name: str) -> None:
    pair = slope(1, 40, 60)
    unknown = MadePair(pair.infocus, pair.defocus, pair.depth, np.zeros_like(pair.valid))
    for pairs in ([], [unknown]):
        with pytest.raises(MethodError, match=r"nothing to fit to|no pair|do not show"):
            load(name).fit(pairs)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", NAMES)
def test_what_another_method_learned_is_refused(name: str) -> None:
    with pytest.raises(MethodError, match="not what this method learns"):
        load(name).restore({"other": np.ones(3)})  # type: ignore[attr-defined]


def test_a_table_follows_a_curve_that_turns_and_leaves_unknown_pixels_out() -> None:
    random = np.random.default_rng(0)
    depth = random.integers(0, 256, (300, 300)).astype(np.uint8)
    valid = random.random((300, 300)) < 0.5
    depth[~valid] = 0
    infocus = np.abs(depth[..., np.newaxis].astype(int) - 100).astype(np.uint8)
    infocus[~valid] = 255
    pair = MadePair(infocus, infocus, depth, valid)
    table = depth_table(lambda sharp, _: sharp[..., 0].astype(float), [pair], "mine")
    assert table["measure"].max() <= 155
    far = table["measure"] > 101
    np.testing.assert_allclose(table["depth"][far], table["measure"][far] + 100, atol=2)


@pytest.mark.parametrize("count", [1, 5, 64, 65, 1000])
def test_indices_are_spread_over_all(count: int) -> None:
    found = evenly_spread(count, 64)
    assert len(found) == len(set(found)) == min(count, 64)
    assert min(found) + max(found) in (count - 1, count)


@pytest.mark.parametrize("value", [[[1.0]], [np.nan], []])
def test_an_array_of_another_shape_or_with_gaps_is_refused(value: Any) -> None:
    with pytest.raises(MethodError, match="mine: table"):
        learned_array({"table": np.array(value)}, "table", "mine", 1)
