"""Stores on disk, in memory and in an S3-compatible object store, written and read alike."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from upath import UPath

from dfdbench.building.build import BuildReport, build_store
from dfdbench.building.sources import open_source
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.fingerprint import verify_store
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.store_writer import StoreWriter
from dfdbench.errors import SourceError, StoreError
from dfdbench.system.cache import cache_entries, remove_entries
from dfdbench.system.location import copy_folder, exists, folders_in
from dfdbench.system.parallel import Threads

Places = Callable[[str], UPath]
Build = Callable[..., BuildReport]


@pytest.fixture
def build(tiny_manifest: Manifest, tiny_folder: Path) -> Build:
    """Build the tiny set from its files as they are then."""

    def build(place: UPath | Path | str, threads: int = 1) -> BuildReport:
        source = open_source(tiny_manifest, tiny_folder)
        return build_store(tiny_manifest, source, place, pool=Threads(threads))

    return build


def test_the_same_store_anywhere(place: Places, build: Build, tiny_store: Dataset) -> None:
    assert build(place("s.zarr"), threads=2).fingerprint == tiny_store.fingerprint
    store = Dataset(str(place("s.zarr")))
    assert store.scenes == tiny_store.scenes
    pair = store.pairs("test")[2]
    region = (slice(3, 9), slice(20, 27))
    expected = tiny_store.read(pair)
    assert np.array_equal(store.read(pair).defocus, expected.defocus)
    assert np.array_equal(store.read(pair, region).infocus, expected.infocus[region])
    assert np.array_equal(store.read(pair, region).valid, expected.valid[region])
    assert store.to_xarray("Two")["images"].dims[0] == "view"
    assert verify_store(store).sound
    assert not exists(place("s.zarr.partial"))
    assert not exists(place(".s.zarr.lock"))
    again = build(place("s.zarr"))
    assert (again.scenes_kept, again.fingerprint) == (tiny_store.scenes, tiny_store.fingerprint)


def test_scenes_that_workers_wrote_elsewhere_make_no_store(
    tmp_path: Path, tiny_manifest: Manifest, build: Build, monkeypatch: pytest.MonkeyPatch
) -> None:
    build(tmp_path / "a.zarr")
    monkeypatch.chdir(tmp_path)
    found = dict(Dataset(tmp_path / "a.zarr").attributes)
    with StoreWriter("a.zarr", tiny_manifest, found) as writer:
        assert str(writer.scenes.partial) == str(tmp_path / "a.zarr.partial")
        with pytest.raises(StoreError, match="the workers wrote 1 scene elsewhere"):
            writer.finish({"One": "0" * 64}, [])
    assert verify_store(Dataset(tmp_path / "a.zarr")).sound


def test_two_builds_do_not_mix_on_disk(tmp_path: Path, tiny_manifest: Manifest) -> None:
    with (
        StoreWriter(tmp_path / "a.zarr", tiny_manifest, {}),
        pytest.raises(StoreError, match="another build"),
        StoreWriter(tmp_path / "a.zarr", tiny_manifest, {}),
    ):
        pass
    with StoreWriter(tmp_path / "a.zarr", tiny_manifest, {}):
        pass


def test_what_a_build_writes_is_not_removed_from_the_cache(
    tmp_path: Path, tiny_manifest: Manifest
) -> None:
    (tmp_path / "stores/b.zarr").mkdir(parents=True)
    with StoreWriter(tmp_path / "stores/a.zarr", tiny_manifest, {}):
        with pytest.raises(StoreError, match="a build is writing this store"):
            remove_entries(cache_entries(tmp_path))
        assert [entry.name for entry in cache_entries(tmp_path)] == ["a.zarr.partial"]
    remove_entries(cache_entries(tmp_path))
    assert list((tmp_path / "stores").iterdir()) == []


def test_a_build_that_failed_goes_on(
    place: Places, build: Build, tiny_folder: Path, tiny_store: Dataset
) -> None:
    image = tiny_folder / "Three/Illum1/Exp0/view1.png"
    right = image.read_bytes()
    image.write_bytes(right[:-20])
    told = r"(?s)damaged.*2 scenes that can be used are kept for the same command"
    with pytest.raises(SourceError, match=told) as caught:
        build(place("s.zarr"))
    assert str(place("s.zarr.partial")) in str(caught.value)
    assert not exists(place("s.zarr"))
    assert {"One", "Two"} <= set(folders_in(place("s.zarr.partial")))
    image.write_bytes(right)
    report = build(place("s.zarr"))
    assert (report.scenes_kept, report.fingerprint) == (("One", "Two"), tiny_store.fingerprint)


def test_a_move_cut_short_goes_on(place: Places, build: Build, tiny_store: Dataset) -> None:
    if place("s.zarr").protocol == "":
        pytest.skip("on disk a folder is renamed at once")
    build(place("s.zarr"))
    # As a kill leaves it: the new store whole beside its place, a part of it there.
    copy_folder(place("s.zarr"), place("s.zarr.partial"))
    (place("s.zarr") / "zarr.json").unlink()
    (place("s.zarr") / "One/zarr.json").unlink()
    with pytest.raises(StoreError):
        Dataset(place("s.zarr"))
    assert build(place("s.zarr")).scenes_built == ()
    assert Dataset(place("s.zarr")).fingerprint == tiny_store.fingerprint


def test_what_is_no_store_is_never_replaced(place: Places, build: Build) -> None:
    folder = place("photographs")
    if folder.protocol == "":
        Path(folder.path).mkdir()
    (folder / "only_copy.png").write_bytes(b"precious")
    with pytest.raises(StoreError, match="no dfdbench store"):
        build(folder)
    assert (folder / "only_copy.png").read_bytes() == b"precious"


def test_an_object_store_that_does_not_answer(build: Build, object_store: str) -> None:
    with pytest.raises(StoreError, match="cannot write the store"):
        build("s3://no-such-bucket/s.zarr")
    with pytest.raises(StoreError, match="no such store"):
        Dataset(f"{object_store}/nothing.zarr")


def test_a_build_that_lacks_pairs_of_the_store_is_refused(
    place: Places, build: Build, tiny_folder: Path, tiny_store: Dataset
) -> None:
    build(place("s.zarr"))
    (tiny_folder / "Two/Illum1/Exp0/view1.png").unlink()
    with pytest.raises(StoreError, match="holds 1 pair that this build lacks"):
        build(place("s.zarr"))
    assert Dataset(place("s.zarr")).fingerprint == tiny_store.fingerprint
    build(place("less.zarr"))


def test_a_build_stopped_before_it_said_what_it_is_goes_on(build: Build, tmp_path: Path) -> None:
    for number, content in enumerate((None, "", '{"zarr_format": 3, "node_type": "group"}')):
        partial = tmp_path / f"{number}.zarr.partial"
        partial.mkdir()
        if content is not None:
            (partial / "zarr.json").write_text(content)
        assert build(tmp_path / f"{number}.zarr").scenes_built
        assert not partial.exists()
