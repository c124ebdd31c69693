import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dfdbench.audit.sides import scene_histograms, sides_of
from dfdbench.building.build import build_store
from dfdbench.building.sources import open_source
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.datasets.store import Store
from dfdbench.errors import InputError, StoreError, UnknownNameError
from tests.conftest import TINY_TOML


def build(toml: str, folder: Path, path: Path) -> Store:
    manifest = parse_manifest(toml.encode(), "tiny-1.toml")
    build_store(manifest, open_source(manifest, folder), path)
    return Store(path)


def test_depth_maps_weigh_by_the_manifests_pairs(tiny_store: Store) -> None:
    histograms = scene_histograms(tiny_store)
    assert {name: h.pairs for name, h in histograms.items()} == {"One": 4, "Two": 4, "Three": 3}
    arrays = tiny_store.to_xarray("Three")
    depth, valid = arrays["depth"].values, arrays["valid"].values
    by_hand = sum(
        weight * np.bincount(depth[view][valid[view]], minlength=256)
        for view, weight in ((0, 2), (1, 1))
    )
    assert (histograms["Three"].counts == by_hand).all()
    assert histograms["Three"].unknown == int(2 * (~valid[0]).sum() + (~valid[1]).sum())


def test_a_store_with_fewer_lightings_gives_the_same_counts(
    tiny_store: Store, tiny_folder: Path, tmp_path: Path
) -> None:
    for image in tiny_folder.rglob("Exp0/view*.png"):
        image.unlink()
    fewer = build(TINY_TOML, tiny_folder, tmp_path / "fewer.zarr")
    assert len(fewer.pairs("all")) < len(tiny_store.pairs("all"))
    whole, part = scene_histograms(tiny_store), scene_histograms(fewer)
    assert all((whole[name].counts == part[name].counts).all() for name in whole)


def test_a_depth_map_that_is_not_there_is_not_taken_for_unknown_pixels(
    tiny_folder: Path, tmp_path: Path
) -> None:
    (tiny_folder / "Two/disp5.png").unlink()
    found = scene_histograms(build(TINY_TOML, tiny_folder, tmp_path / "s.zarr"))["Two"]
    assert found.pairs == 2
    assert found.known + found.unknown == 2 * 24 * 31


def lose(path: Path) -> None:
    shutil.rmtree(path / "Two/depth")


def lose_chunks(path: Path) -> None:
    shutil.rmtree(path / "Two/depth/c")


def garble(path: Path) -> None:
    for chunk in (path / "Two/depth/c").rglob("*"):
        if chunk.is_file():
            chunk.write_bytes(b"no zstd frame")


def truncate(path: Path) -> None:
    (path / "Two/depth/zarr.json").write_text("{")


def declare_floats(path: Path) -> None:
    about = path / "Two/depth/zarr.json"
    about.write_text(about.read_text().replace('"uint8"', '"float32"'))


def lose_record(path: Path) -> None:
    about = path / "Two/zarr.json"
    content = json.loads(about.read_text())
    content["attributes"]["array_digests"] = "lost"
    about.write_text(json.dumps(content))


@pytest.mark.parametrize(
    "damage", [lose, lose_chunks, garble, truncate, declare_floats, lose_record]
)
def test_a_damaged_depth_map_is_told_and_never_counted(
    tiny_store: Store, damage: Callable[[Path], None]
) -> None:
    damage(Path(str(tiny_store.path)))
    with pytest.raises(StoreError) as caught:
        scene_histograms(Store(tiny_store.path))
    assert "Two" in str(caught.value)
    assert "dfdbench verify" in str(caught.value) or "dfdbench build" in str(caught.value)


def test_splits_folds_and_scenes_part_the_data_set(tiny_store: Store) -> None:
    train, test = sides_of(tiny_store)
    assert (list(train.scenes), list(test.scenes)) == (["One"], ["Two", "Three"])
    train, test = sides_of(tiny_store, fold="K1")
    assert (list(train.scenes), list(test.scenes)) == (["Three"], ["One", "Two"])
    assert train.name == "all but K1"
    train, test = sides_of(tiny_store, fold="Two")
    assert (list(train.scenes), list(test.scenes)) == (["One", "Three"], ["Two"])
    with pytest.raises(InputError, match="a fold says both"):
        sides_of(tiny_store, test="all", fold="K1")
    with pytest.raises(UnknownNameError):
        sides_of(tiny_store, fold="K9")
    with pytest.raises(UnknownNameError, match="fold or scene"):
        sides_of(tiny_store, fold="all")


def test_scenes_that_are_not_built_are_named(tiny_folder: Path, tmp_path: Path) -> None:
    for file in (tiny_folder / "Two").rglob("*.png"):
        file.unlink()
    store = build(TINY_TOML, tiny_folder, tmp_path / "s.zarr")
    assert sides_of(store)[1].absent == ("Two",)
    with pytest.raises(StoreError, match="no depth of Two"):
        sides_of(store, test="Two")


def test_levels_are_turned_round_between_sets_that_grow_the_other_way(
    tiny_store: Store, tiny_folder: Path, tmp_path: Path
) -> None:
    # The same depth maps, declared as distances: Eq. 7.1 maps level 4 to 251.
    far = build(
        TINY_TOML.replace('"nearness"', '"distance"').replace('name = "tiny"', 'name = "far"'),
        tiny_folder,
        tmp_path / "far.zarr",
    )
    _, test = sides_of(tiny_store, other=far)
    assert test.inverted
    assert test.name == "all"
    stored = sum(h.counts for h in scene_histograms(far).values())
    assert (test.histogram.counts == np.asarray(stored)[::-1]).all()
    # Within one data set nothing is turned, whichever way it grows.
    assert not any(side.inverted for side in sides_of(far))
    assert not sides_of(far, other=far)[1].inverted
