import re
from pathlib import Path

import pytest

from dfdbench.building.fetching import lock_name
from dfdbench.datasets import catalog
from dfdbench.errors import InputError, ManifestError, UnknownNameError
from tests.conftest import TINY_TOML


def test_a_manifest_is_found_by_each_of_its_names_and_its_heading_says_the_same() -> None:
    manifests = catalog.released_manifests()
    for heading, manifest in zip(catalog.released_headings(), manifests, strict=True):
        for name, value in heading:
            assert getattr(manifest, name) == value
        assert heading.stem == manifest.stem
        for name in (manifest.stem, manifest.name, manifest.short):
            assert catalog.find_manifest(name) == manifest


def test_a_manifest_of_ones_own_is_named_by_its_path(tmp_path: Path) -> None:
    folder = tmp_path / "me@home"
    folder.mkdir()
    (folder / "tiny-1.toml").write_text(TINY_TOML)
    assert catalog.find_manifest(str(folder / "tiny-1.toml")).stem == "tiny-1"
    assert catalog.find_manifest(f"{folder / 'tiny-1.toml'}@gain-3").stem == "tiny-1@gain-3"
    assert not catalog.is_place(f"{folder / 'tiny-1.toml'}@gain-3")
    assert catalog.is_place(f"{folder}/tiny")
    for name, stem in (("demo", "demo-1"), ("unseen-7", "unseen-7-1")):
        edited = re.sub(
            "network_crop = [0-9]+", "network_crop = 16", catalog.find_manifest(name).toml
        )
        (tmp_path / f"{stem}.toml").write_text(edited)
        with pytest.raises(ManifestError, match=f"the name of the released {stem}"):
            catalog.find_manifest(str(tmp_path / f"{stem}.toml"))
    with pytest.raises(ManifestError, match="cannot read the manifest"):
        catalog.find_manifest("demo.toml")


def test_a_path_is_told_from_a_name() -> None:
    for name in ("middlebury-third-1", "sets/mine.toml"):
        assert not catalog.is_place(name)
    for place in ("mine.zarr", "tiny-1@gain-3.zarr", "./mine", "s3://bucket/a"):
        assert catalog.is_place(place)


def test_a_set_of_ones_own_is_known_by_its_name_once_built(tmp_path: Path) -> None:
    assert catalog.own_stores(tmp_path) == {}
    stores = tmp_path / "stores"
    for name in ("lab-2", "lab-10", "lab-bench", "demo-1@noise-1", "demo-7", "lab-10.zarr.partial"):
        (stores / (name if "partial" in name else f"{name}.zarr")).mkdir(parents=True)
    own = {name: name for name in ("demo-7", "lab-10", "lab-2", "lab-bench")} | {"lab": "lab-10"}
    found = catalog.own_stores(tmp_path)
    assert found == {name: stores / f"{stem}.zarr" for name, stem in own.items()}
    assert catalog.place_of("lab", tmp_path) == stores / "lab-10.zarr"
    assert catalog.place_of("elsewhere/lab.zarr", tmp_path) == "elsewhere/lab.zarr"
    assert catalog.place_of("demo", tmp_path) is None
    assert catalog.place_of("lab-10.toml", tmp_path) is None


def test_a_set_on_a_track_is_the_same_but_for_its_name() -> None:
    clean, tracked = catalog.find_manifest("demo"), catalog.find_manifest("demo-1@camera-2")
    assert (tracked.stem, tracked.short) == ("demo-1@camera-2", "demo@camera-2")
    assert (tracked.degradation, tracked.on_track, clean.on_track) == ("camera-2", True, False)
    assert (tracked.sha256, tracked.name) == (clean.sha256, clean.name)
    assert tracked.pairs("test") == clean.pairs("test")
    assert catalog.find_manifest(tracked.short) == tracked


def test_it_has_a_place_of_its_own_but_the_files_of_the_clean_set(tmp_path: Path) -> None:
    clean, tracked = catalog.find_manifest("middlebury"), catalog.find_manifest("middlebury@law-1")
    assert catalog.default_store(tracked, tmp_path).name == "middlebury-third-1@law-1.zarr"
    assert (tracked.file_stem, lock_name(tracked)) == (clean.file_stem, lock_name(clean))


def test_near_misses_and_tracks_of_captured_sets_are_told() -> None:
    for name, said in (
        ("midlebury", "midlebury(?s:.*)did you mean middlebury"),
        ("demo@camera-9", "did you mean camera-3"),
        ("demo@", "unknown track: nothing follows the @"),
        ("dmo@camera-2", "did you mean demo"),
        ("demo@camera-2@noise-1", r"(?s)one track at a time.*demo@camera-2 or demo@noise-1"),
        ("demo@../camera-2", "unknown data set"),
    ):
        with pytest.raises(UnknownNameError, match=said):
            catalog.find_manifest(name)
    with pytest.raises(InputError, match=r"(?s)captured.*realworld@noise-0"):
        catalog.find_manifest("realworld@noise-0")
