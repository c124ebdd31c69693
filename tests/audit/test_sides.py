import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.audit import sides
from dfdbench.audit.run_errors import level_count_table
from dfdbench.building.sources import open_source
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, StoreError, UnknownNameError
from tests.conftest import TINY_TOML, store_of


def test_expected_uses_are_those_of_all_crops() -> None:
    height, width, crop = 7, 9, 4
    uses = np.zeros((height, width))
    places = [(y, x) for y in range(height - crop + 1) for x in range(width - crop + 1)]
    for y, x in places:
        uses[y : y + crop, x : x + crop] += 1
    assert sides.expected_uses((height, width), crop) == pytest.approx(uses / len(places))


def test_the_crop_expansion_is_about_what_the_thesis_reports(shared_data: Path) -> None:
    # 5.2.1: each image was drawn 8753.74 times, each level used "approximately 422 times more".
    folder = shared_data / "middlebury"
    manifest = find_manifest("middlebury-default")
    source = open_source(manifest, folder)
    scenes = dict.fromkeys(pair.scene for pair in source.available_pairs())
    maps = [source.read(scene) for scene in list(scenes)[:6]]
    histograms = [
        sides.depth_histogram(manifest.depth.levels_of(scene.depth[view]), scene.valid[view])
        for scene in maps
        for view in (0, 1)
    ]
    used = 8753.74 * sum(h.expanded.sum() for h in histograms)
    assert 380 < used / sum(h.known for h in histograms) < 470


@given(keys=st.lists(st.sampled_from(["a", "b", None]), max_size=20))
def test_runs_are_whole_apart_and_of_one_key(keys: list[str | None]) -> None:
    found = sides.runs(keys)
    held = {level for first, last in found for level in range(first, last + 1)}
    assert held == {level for level, key in enumerate(keys) if key is not None}
    for first, last in found:
        assert len(set(keys[first : last + 1])) == 1
    for (_, last), (first, _) in itertools.pairwise(found):
        # Neighbours of one key would be one run.
        assert first > last + 1 or keys[first] != keys[last]


def test_depth_maps_weigh_by_the_manifests_pairs(tiny_store: Dataset) -> None:
    histograms = sides.scene_histograms(tiny_store)
    assert {name: h.pairs for name, h in histograms.items()} == {"One": 4, "Two": 4, "Three": 3}
    arrays = tiny_store.to_xarray("Three")
    depth = tiny_store.manifest.depth.levels_of(arrays["depth"].values)
    valid = np.isfinite(arrays["depth"].values)
    by_hand = sum(
        weight * np.bincount(depth[view][valid[view]], minlength=256)
        for view, weight in ((0, 2), (1, 1))
    )
    assert (histograms["Three"].counts == by_hand).all()
    assert histograms["Three"].unknown == int(2 * (~valid[0]).sum() + (~valid[1]).sum())


def test_an_absent_depth_map_is_not_unknown_pixels(tiny_folder: Path, tmp_path: Path) -> None:
    (tiny_folder / "Two/disp5.png").unlink()
    found = sides.scene_histograms(store_of(TINY_TOML, tiny_folder, tmp_path / "s.zarr"))["Two"]
    assert found.pairs == 2
    assert found.known + found.unknown == 2 * 24 * 31


def test_splits_folds_and_scenes_part_the_data_set(tiny_store: Dataset) -> None:
    train, test = sides.sides_of(tiny_store)
    assert (list(train.scenes), list(test.scenes)) == (["One"], ["Two", "Three"])
    train, test = sides.sides_of(tiny_store, fold="K1")
    assert (list(train.scenes), list(test.scenes)) == (["Three"], ["One", "Two"])
    assert train.name == "all but K1"
    train, test = sides.sides_of(tiny_store, fold="Two")
    assert (list(train.scenes), list(test.scenes)) == (["One", "Three"], ["Two"])
    with pytest.raises(InputError, match="--test cannot be given with --fold"):
        sides.sides_of(tiny_store, test="all", fold="K1")
    with pytest.raises(UnknownNameError, match="fold or scene"):
        sides.sides_of(tiny_store, fold="all")


def test_scenes_that_are_not_built_are_named(tiny_folder: Path, tmp_path: Path) -> None:
    for file in (tiny_folder / "Two").rglob("*.png"):
        file.unlink()
    store = store_of(TINY_TOML, tiny_folder, tmp_path / "s.zarr")
    side = sides.sides_of(store)[1]
    assert side.absent == ("Two",)
    assert level_count_table(side).notes[-1] == "not in the store, so not counted: Two"
    with pytest.raises(StoreError, match="no depth of Two"):
        sides.sides_of(store, test="Two")


def test_levels_are_turned_round_between_sets_that_grow_the_other_way(
    tiny_store: Dataset, tiny_folder: Path, tmp_path: Path
) -> None:
    # The same depth maps, declared as distances: Eq. 7.1 maps level 4 to 251.
    text = TINY_TOML.replace('"nearness"', '"distance"').replace('name = "tiny"', 'name = "far"')
    far = store_of(text, tiny_folder, tmp_path / "far.zarr")
    _, test = sides.sides_of(tiny_store, other=far)
    assert test.inverted
    assert test.name == "all"
    stored = sides.DepthHistogram.total(list(sides.scene_histograms(far).values()))
    assert (test.histogram.counts == stored.counts[::-1]).all()
    assert (test.histogram.expanded == stored.expanded[::-1]).all()
    # Within one data set nothing is turned, whichever way it grows.
    assert not any(side.inverted for side in sides.sides_of(far))
    assert not sides.sides_of(far, other=far)[1].inverted


def test_a_crop_shows_as_many_pixels_as_it_has_in_eight_orientations() -> None:
    depth = np.full((60, 90), 77, np.uint8)
    whole = sides.depth_histogram(depth, np.ones(depth.shape, bool))
    assert whole.expanded.sum() == pytest.approx(8 * 32 * 32)
    small = sides.depth_histogram(depth[:10], np.ones((10, 90), bool))
    assert small.expanded.sum() == pytest.approx(8 * 10 * 32)
