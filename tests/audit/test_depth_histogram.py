from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dfdbench.audit.depth_histogram import depth_histogram, expected_uses
from dfdbench.building.sources import open_source
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import InputError


def test_unknown_pixels_are_apart_and_pairs_weigh() -> None:
    depth = np.array([[0, 0, 9, 9, 80]], np.uint8)
    once, thrice = (depth_histogram(depth, depth > 0, pairs) for pairs in (1, 3))
    assert (once.known, once.unknown) == (3, 2)
    assert (thrice.counts == 3 * once.counts).all()
    assert (thrice.unknown, thrice.pairs) == (6, 3)
    assert once.counts[0] == 0


def test_inverting_turns_every_level_round() -> None:
    depth = np.array([[4, 8, 250]], np.uint8)
    turned = depth_histogram(255 - depth, depth > 0)
    inverted = depth_histogram(depth, depth > 0).inverted()
    assert (inverted.counts == turned.counts).all()
    assert inverted.expanded == pytest.approx(turned.expanded)


def test_expected_uses_are_those_of_all_crops() -> None:
    height, width, crop = 7, 9, 4
    uses = np.zeros((height, width))
    places = [(y, x) for y in range(height - crop + 1) for x in range(width - crop + 1)]
    for y, x in places:
        uses[y : y + crop, x : x + crop] += 1
    assert expected_uses((height, width), crop) == pytest.approx(uses / len(places))


def test_a_crop_shows_as_many_pixels_as_it_has_in_eight_orientations() -> None:
    depth = np.full((60, 90), 77, np.uint8)
    whole = depth_histogram(depth, np.ones(depth.shape, bool))
    assert whole.expanded.sum() == pytest.approx(8 * 32 * 32)
    small = depth_histogram(depth[:10], np.ones((10, 90), bool))
    assert small.expanded.sum() == pytest.approx(8 * 10 * 32)


def test_the_crop_expansion_is_about_what_the_thesis_reports(shared_data: Path) -> None:
    # 5.2.1: each image was drawn 8753.74 times, each level used "approximately 422 times more".
    folder = shared_data / "middlebury"
    source = open_source(find_manifest("middlebury-default"), folder)
    scenes = dict.fromkeys(pair.scene for pair in source.available_pairs())
    maps = [source.read(scene) for scene in list(scenes)[:6]]
    histograms = [
        depth_histogram(scene.depth[view], scene.valid[view]) for scene in maps for view in (0, 1)
    ]
    used = 8753.74 * sum(h.expanded.sum() for h in histograms)
    assert 380 < used / sum(h.known for h in histograms) < 470


def test_what_is_no_depth_map_is_refused() -> None:
    with pytest.raises(InputError, match="not a depth map"):
        depth_histogram(np.zeros((3, 3), np.float32), np.ones((3, 3), bool))
