"""Regions are where they are said to be, and their errors are the protocol's."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfdbench.metrics.regions import REGIONS, region_errors, regions_of
from dfdbench.metrics.scores import nrmse

LEVELS = (255.0, 0.0)
NOISE = np.random.default_rng(0).integers(0, 256, (40, 60, 3)).astype(np.uint8)
KNOWN = np.ones((40, 60), bool)


def test_edges_are_three_pixels_to_either_side_of_a_jump_and_a_slope_has_none() -> None:
    depth = np.full((40, 60), 100.0)
    depth[:, 30:] = 111
    found = regions_of(depth, KNOWN, NOISE, LEVELS)["edges"]
    assert np.flatnonzero(found[7]).tolist() == [27, 28, 29, 30, 31, 32]
    depth[:, 30:] = 109
    assert not regions_of(depth, KNOWN, NOISE, LEVELS)["edges"].any()
    slope = np.tile(np.linspace(0, 255, 60), (40, 1))
    assert not regions_of(slope, KNOWN, NOISE, LEVELS)["edges"].any()
    # In metres the same share of the range is a jump, whichever way it goes.
    metres = np.where(np.arange(60) < 30, 2.0, 2.3) + np.zeros((40, 1))
    assert regions_of(metres, KNOWN, NOISE, (0.5, 6.0))["edges"].sum() == 6 * 40


def test_what_nobody_knows_makes_no_edge_and_is_in_no_region() -> None:
    depth, known = np.full((40, 60), 200.0), KNOWN.copy()
    depth[10:20, 10:20] = 0
    known[10:20, 10:20] = False
    found = regions_of(depth, known, np.zeros_like(NOISE), LEVELS)
    assert not found["edges"].any()
    for mask in found.values():
        assert not mask[~known].any()
    assert found["near"].sum() == found["flat"].sum() == known.sum()


def test_flat_is_where_the_image_shows_little() -> None:
    image = NOISE.copy()
    image[:, :30] = 128
    found = regions_of(np.full((40, 60), 9.0), KNOWN, image, LEVELS)["flat"]
    # A window of 7 reaches three pixels beyond its middle.
    assert found[:, :27].all()
    assert not found[:, 30:].any()


def test_flat_is_a_standard_deviation_below_three() -> None:
    squares = np.indices((40, 60)).sum(axis=0)[..., np.newaxis] % 2 * np.ones(3)
    for step, flat in ((5, True), (7, False)):
        # Half of the pixels are so much brighter: a deviation of half of it.
        image = (100 + step * squares).astype(np.uint8)
        found = regions_of(np.full((40, 60), 9.0), KNOWN, image, LEVELS)["flat"]
        assert found.all() == found.any() == flat


@pytest.mark.parametrize("ends", [(255.0, 0.0), (0.0, 255.0), (0.5, 6.5)])
def test_thirds_go_by_the_range_whichever_way_depth_goes(ends: tuple[float, float]) -> None:
    near, far = ends
    share = np.tile(np.linspace(0.005, 0.995, 60), (40, 1))
    found = regions_of(far + share * (near - far), KNOWN, NOISE, ends)
    assert np.array_equal(found["far"], share < 1 / 3)
    assert np.array_equal(found["near"], share > 2 / 3)


@given(
    hnp.arrays(np.float64, (6, 8), elements=st.floats(0, 255)),
    hnp.arrays(np.float64, (6, 8), elements=st.floats(0, 255)),
    hnp.arrays(np.bool_, (6, 8)),
)
def test_the_error_is_that_of_the_known_pixels_there(truth: Any, test: Any, mask: Any) -> None:
    (found,) = region_errors(truth, test, {"far": mask}, 255).values()
    expected = nrmse(truth, test, data_range=255, mask=mask)
    assert found == (None if math.isnan(expected) else pytest.approx(expected))


def test_a_region_with_a_gap_has_no_error() -> None:
    truth = np.zeros((1, 3))
    regions = {"far": np.array([[True, True, False]]), "near": np.array([[False, False, True]])}
    found = region_errors(truth, np.array([[1.0, np.nan, 4.0]]), regions, 4)
    assert found == {"far": None, "near": 1}
    assert list(REGIONS) == ["edges", "flat", "far", "near"]
