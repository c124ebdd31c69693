from pathlib import Path

import numpy as np
import pytest
import xarray
import zarr

from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.building.build import build_store
from dfdbench.building.sources import open_source
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.store import Store, open_store
from dfdbench.datasets.store_writer import StoreWriter
from dfdbench.errors import StoreError
from dfdbench.system.location import as_location, remove


def test_a_store_says_what_it_is(tiny_store: Store, tiny_manifest: Manifest) -> None:
    attributes = tiny_store.attributes
    assert attributes["manifest_sha256"] == tiny_manifest.sha256
    assert attributes["recipe"] == {
        "name": "published",
        "parameters": RECIPES["published"].as_dict(),
    }
    assert attributes["degradation"] == "clean"
    assert attributes["missing_pairs"] == []
    assert tiny_store.manifest == tiny_manifest
    assert tiny_store.recipe == RECIPES["published"]
    assert len(tiny_store.fingerprint) == 64


def test_it_opens_as_a_plain_datatree(tiny_store: Store) -> None:
    tree = xarray.open_datatree(str(tiny_store.path), engine="zarr", consolidated=False)
    scene = tree["Two"]
    assert scene["infocus"].dims == ("view", "illumination", "exposure", "y", "x", "channel")
    assert scene["infocus"].dtype == scene["defocus"].dtype == scene["depth"].dtype == np.uint8
    assert scene["depth"].dims == scene["valid"].dims == ("view", "y", "x")
    assert scene["available"].dims == ("view", "illumination", "exposure")
    assert not bool(tree["Three"]["available"].sel(view=5, illumination=1, exposure=1))
    assert zarr.open_array(str(tiny_store.path / "Two/infocus")).chunks == (1, 1, 1, 24, 31, 3)


def test_a_pair_is_what_the_files_hold(tiny_store: Store) -> None:
    pairs = tiny_store.pairs("test")
    assert pairs == tiny_store.manifest.pairs("test")
    for pair in pairs:
        images = tiny_store.read(pair)
        assert np.array_equal(images.valid, images.depth != 0)
        again = synthesize(images.infocus, images.depth, RECIPES["published"])
        assert np.array_equal(images.defocus, again)


def test_what_is_no_store_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no such store"):
        Store(tmp_path / "none.zarr")
    zarr.open_group(tmp_path / "other.zarr", mode="w")
    with pytest.raises(StoreError, match="not a data set built by dfdbench"):
        Store(tmp_path / "other.zarr")
    zarr.open_group(tmp_path / "other.zarr", mode="a").attrs.update(
        {"format": "dfdbench store", "format_version": 99}
    )
    with pytest.raises(StoreError, match="another version"):
        open_store(str(tmp_path / "other.zarr"))
    (tmp_path / "file.zarr").write_text("x")
    with pytest.raises(StoreError):
        Store(tmp_path / "file.zarr")


def test_a_data_set_that_is_not_built_says_how(tmp_path: Path) -> None:
    with pytest.raises(StoreError) as caught:
        open_store("middlebury")
    assert "dfdbench build middlebury" in str(caught.value)
    assert "dfdbench build demo" in str(caught.value)


def test_two_builds_do_not_mix(tiny_manifest: Manifest, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    second = StoreWriter(path, tiny_manifest, {})
    with (
        StoreWriter(path, tiny_manifest, {}),
        pytest.raises(StoreError, match="another build"),
        second,
    ):
        pass
    with StoreWriter(path, tiny_manifest, {}):
        pass


@pytest.mark.parametrize("suffix", ["", ".partial"])
def test_what_is_no_store_is_never_replaced(
    tiny_manifest: Manifest, tiny_folder: Path, tmp_path: Path, suffix: str
) -> None:
    source = open_source(tiny_manifest, tiny_folder)
    folder = tmp_path / f"photographs{suffix}"
    folder.mkdir()
    (folder / "only_copy.png").write_text("precious")
    with pytest.raises(StoreError, match="no dfdbench store"):
        build_store(tiny_manifest, source, tmp_path / "photographs")
    assert (folder / "only_copy.png").read_text() == "precious"
    (tmp_path / "file").write_text("precious")
    with pytest.raises(StoreError, match="no dfdbench store"):
        build_store(tiny_manifest, source, tmp_path / "file")
    with pytest.raises(StoreError, match="File name too long") as caught:
        build_store(tiny_manifest, source, tmp_path / ("x" * 300))
    assert caught.value.problems[0].fix.startswith("choose another place")
    assert (tmp_path / "file").read_text() == "precious"


def test_a_store_of_another_recipe_is_not_replaced(
    tiny_manifest: Manifest, tiny_folder: Path, tiny_store: Store
) -> None:
    source = open_source(tiny_manifest, tiny_folder)
    with pytest.raises(StoreError, match="another blur recipe"):
        build_store(tiny_manifest, source, tiny_store.path, recipe="text")
    assert Store(tiny_store.path).recipe_name == "published"


def test_a_damaged_scene_is_written_again(
    tiny_manifest: Manifest, tiny_folder: Path, tiny_store: Store
) -> None:
    before = tiny_store.fingerprint
    chunk = next(path for path in (tiny_store.path / "Two/defocus/c").rglob("*") if path.is_file())
    chunk.unlink()
    report = build_store(tiny_manifest, open_source(tiny_manifest, tiny_folder), tiny_store.path)
    assert report.fingerprint == before
    assert report.scenes_built == ("Two",)


def test_a_full_disk_is_told_and_nothing_is_lost(
    tiny_manifest: Manifest, tiny_folder: Path, tiny_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = open_source(tiny_manifest, tiny_folder)
    original = xarray.Dataset.to_zarr
    other = tiny_store.path.with_name("other.zarr")
    written: list[str] = []

    def full(dataset: xarray.Dataset, *args: object, **keywords: object) -> object:
        if len(written) == 1:
            raise OSError(28, "No space left on device")
        written.append(str(keywords["group"]))
        return original(dataset, *args, **keywords)  # type: ignore[call-overload]

    with monkeypatch.context() as patch:
        patch.setattr(xarray.Dataset, "to_zarr", full)
        with pytest.raises(StoreError, match="No space left on device") as caught:
            build_store(tiny_manifest, source, other)
    assert caught.value.problems[0].fix.startswith("make room, or choose another place")
    assert not other.exists()
    report = build_store(tiny_manifest, source, other)
    assert report.scenes_kept == tuple(written)
    assert report.fingerprint == tiny_store.fingerprint
    remove(as_location(other))


def test_a_scene_whose_record_is_damaged_is_told(tiny_store: Store) -> None:
    (Path(str(tiny_store.path)) / "Two/zarr.json").write_text("{")
    with pytest.raises(StoreError, match="cannot read the store"):
        Store(tiny_store.path)
