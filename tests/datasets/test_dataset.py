from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
import zarr

from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.errors import InputError, StoreError, UnknownNameError
from tests.conftest import TINY_TOML


def test_it_opens_as_a_plain_datatree(tiny_store: Dataset) -> None:
    tree = xarray.open_datatree(str(tiny_store.path), engine="zarr", consolidated=False)
    scene = tree["Two"]
    axes = ("view", "illumination", "exposure")
    assert scene["images"].dims == (*axes, "image", "y", "x", "channel")
    assert scene["images"].dtype == np.uint8
    assert scene["depth"].dtype == np.float32
    assert scene["depth"].dims == ("view", "y", "x")
    assert not bool(tree["Three"]["available"].sel(view=5, illumination=1, exposure=1))
    assert zarr.open_array(str(tiny_store.path / "Two/images")).chunks == (1, 1, 1, 1, 24, 31, 3)


def test_a_pair_is_what_the_files_hold(tiny_store: Dataset) -> None:
    pairs = tiny_store.pairs("test")
    assert pairs == tiny_store.manifest.pairs("test")
    for pair in pairs:
        images = tiny_store.read(pair)
        assert np.array_equal(images.valid, images.levels != 0)
        again = synthesize(images.infocus, images.levels, RECIPES["published"])
        assert np.array_equal(images.defocus, again)
        # Who writes into a capture changes none that is read later.
        images.facts.f_number[:] = 7
        assert not (tiny_store.read(pair).facts.f_number == 7).any()


def test_what_is_not_of_the_set_is_no_damage(tiny_store: Dataset) -> None:
    with pytest.raises(UnknownNameError, match="did you mean Two"):
        tiny_store.shape_of("Twoo")
    pair = tiny_store.pairs("test")[0]
    for other in (
        Pair("Art", pair.coordinates),
        Pair(pair.scene, (*pair.coordinates, ("lens", 1))),
    ):
        with pytest.raises(InputError, match="no pair of tiny-1"):
            tiny_store.read(other)


def test_what_is_no_store_is_said_so(tmp_path: Path) -> None:
    zarr.open_group(tmp_path / "other.zarr", mode="w")
    with pytest.raises(StoreError, match="not a data set built by dfdbench"):
        Dataset(tmp_path / "other.zarr")
    attributes = zarr.open_group(tmp_path / "other.zarr", mode="a").attrs
    attributes.update({"format": "dfdbench store", "format_version": 99})
    with pytest.raises(StoreError, match="version 99, not 1"):
        open_dataset(str(tmp_path / "other.zarr"))
    (tmp_path / "file.zarr").write_text("x")
    with pytest.raises(StoreError):
        Dataset(tmp_path / "file.zarr")


def test_a_set_whose_manifest_was_edited_is_to_be_built_again(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    (tmp_path / "stores").mkdir()
    tiny_store.path.rename(tmp_path / "stores/tiny-1.zarr")
    own = tmp_path / "tiny.toml"
    own.write_text(TINY_TOML)
    assert open_dataset(own, cache=tmp_path).manifest.name == "tiny"
    words = TINY_TOML.replace('title = "', 'title = "My own ')
    own.write_text(words + "# better\n")
    assert (words != TINY_TOML, open_dataset(own, cache=tmp_path).manifest.name) == (True, "tiny")
    own.write_text(TINY_TOML.replace("network_crop = ", "network_crop = 1"))
    told = r"set tiny was made from another manifest: edited, or another[^$]*dfdbench build "
    with pytest.raises(StoreError, match=told):
        open_dataset(own, cache=tmp_path)


def test_pairs_are_read_when_they_are_asked_for(tiny_store: Dataset) -> None:
    data = open_dataset("tiny", tiny_store.path).captures("test")
    assert len(data) == 7
    assert [images.pair for images in data] == list(tiny_store.pairs("test"))
    assert np.array_equal(data[-1].defocus, tiny_store.read(tiny_store.pairs("test")[-1]).defocus)
    assert [part.pair for part in data[2:5]] == [data[at].pair for at in (2, 3, 4)]
    for read in (data.__getitem__, data.crop):
        with pytest.raises(IndexError, match=r"no pair 7: <7 pairs of .*> has 0 to 6"):
            read(7)
    wrong: Any = "One/1"
    with pytest.raises(TypeError, match=r"found by its place, as data\[0\]; got 'One/1'"):
        data[wrong]


def test_a_crop_decodes_its_own_pair_only(tiny_store: Dataset) -> None:
    data = open_dataset(str(tiny_store.path)).captures()
    region = (slice(4, 12), slice(10, 26))
    whole = data[1]
    for name in ("infocus", "defocus", "levels", "valid"):
        crop = getattr(data.crop(1, region), name)
        assert np.array_equal(crop, getattr(whole, name)[region])
    # With every other image of the scene damaged, the crop is still read.
    for chunk in Path(tiny_store.path.path, "One/images").glob("c*"):
        if not chunk.name.startswith("c.0.0.1."):
            chunk.write_bytes(b"rot")
    assert np.array_equal(data.crop(1, region).infocus, whole.infocus[region])
    with pytest.raises(StoreError, match="dfdbench verify"):
        data.crop(0, region)


def test_a_crop_beyond_the_image_is_refused(tiny_store: Dataset) -> None:
    data = open_dataset("tiny", tiny_store.path).captures("One")
    regions: list[tuple[Any, str]] = [
        ((slice(20, 28), slice(0, 8)), "20 to 28.*rows"),
        ((slice(0, 8), slice(0, 31)), "0 to 31.*columns"),
        ((slice(8, 8), slice(-99, None)), "8 to 8.*rows.*-99"),
        ((0, 0), "two slices"),
        ((slice(0, 3),), "two slices"),
    ]
    for region, said in regions:
        with pytest.raises(InputError, match=f"(?s){said}"):
            data.crop(0, region)
    assert data.crop(0, (slice(16, 24), slice(-8, None))).depth.shape == (8, 8)
