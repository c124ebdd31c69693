import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.blur.recipe import RECIPES
from dfdbench.errors import MethodError
from dfdbench.methods.sgm import MOST, SemiGlobal, path_costs, path_costs_by_bands
from tests.methods.made_planes import pair_of, texture

PUBLISHED = RECIPES["published"]


def test_it_fills_what_has_no_texture_from_around() -> None:
    infocus = texture(5)
    infocus[20:40, 30:50] = 120
    pair = pair_of(infocus, np.full((64, 80), 90, np.uint8))
    found = SemiGlobal(PUBLISHED)(pair.infocus, pair.defocus)
    assert np.abs(found[24:36, 34:46] - 90).max() < 5


def test_a_small_step_above_the_large_one_is_refused() -> None:
    # The one that was set may be either: the other is the default then.
    for small, large in ((20.0, 15.0), (0.5, 0.25)):
        with pytest.raises(MethodError, match=r"small_step .* is above large_step"):
            SemiGlobal(small_step=small, large_step=large)


def by_definition(
    costs: NDArray[np.uint16], small: int, large: int, directions: int = 8
) -> NDArray[np.int64]:
    """Follow Eq. 13 of the paper, a pixel and a direction at a time."""
    height, width, labels = costs.shape
    total = np.zeros(costs.shape, np.int64)
    away = np.abs(np.subtract.outer(np.arange(labels), np.arange(labels)))
    steps = np.choose(np.minimum(away, 2), [0, small, large])
    for down, right in itertools.product((-1, 0, 1), repeat=2):
        if (down, right) == (0, 0) or (directions == 4 and down and right):
            continue
        paths: dict[tuple[int, int], NDArray[np.int64]] = {}
        for y in range(height)[:: -1 if down < 0 else 1]:
            for x in range(width)[:: -1 if right < 0 else 1]:
                before = paths.get((y - down, x - right))
                paths[y, x] = costs[y, x].astype(np.int64)
                if before is not None:
                    paths[y, x] += (before + steps).min(1) - before.min()
                total[y, x] += paths[y, x]
    return total


@pytest.mark.parametrize("directions", [4, 8])
@pytest.mark.parametrize("shape", [(1, 1, 2), (1, 7, 5), (6, 1, 4), (5, 8, 9)])
def test_path_costs_are_as_the_definition(shape: tuple[int, int, int], directions: int) -> None:
    costs = np.random.default_rng(0).integers(0, 60, shape).astype(np.uint16)
    expected = by_definition(costs, 5, 17, directions)
    assert np.array_equal(path_costs(costs, 5, 17, directions), expected)


@pytest.mark.parametrize("directions", [4, 8])
@pytest.mark.parametrize("rows", [1, 2, 3, 6, 7, 20])
def test_bands_have_the_path_costs_of_the_whole(rows: int, directions: int) -> None:
    costs = np.random.default_rng(rows).integers(0, 60, (7, 9, 5)).astype(np.uint16)
    found, asked = np.zeros_like(costs), list[slice]()

    def costs_of(band: slice) -> NDArray[np.uint16]:
        asked.append(band)
        return costs[band].copy()

    for band, sums in path_costs_by_bands(costs_of, costs.shape, 5, 17, directions, rows):
        found[band] = sums
    assert np.array_equal(found, path_costs(costs, 5, 17, directions))
    assert max(band.stop - band.start for band in asked) == min(rows, 7)


@pytest.mark.parametrize("large", [1, MOST // 2, MOST])
def test_the_largest_costs_do_not_overflow(large: int) -> None:
    costs = np.random.default_rng(0).choice([0, MOST - large], (12, 12, 6)).astype(np.uint16)
    assert np.array_equal(path_costs(costs, large, large), by_definition(costs, large, large))
