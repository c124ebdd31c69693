from dataclasses import asdict
from pathlib import Path

import pytest

from dfdbench.building.fetching import lock_name
from dfdbench.datasets.catalog import (
    default_store,
    find_manifest,
    is_place,
    own_stores,
    place_of,
    released_headings,
    released_manifests,
)
from dfdbench.errors import InputError, ManifestError, UnknownNameError
from tests.conftest import TINY_TOML


def test_brighter_is_nearer_in_every_set() -> None:
    assert {manifest.depth.grows_with for manifest in released_manifests()} == {"nearness"}


def test_a_heading_says_what_the_manifest_does() -> None:
    for heading, manifest in zip(released_headings(), released_manifests(), strict=True):
        for name, value in asdict(heading).items():
            assert getattr(manifest, name) == value
        assert heading.stem == manifest.stem


def test_a_manifest_is_found_by_each_of_its_names() -> None:
    for manifest in released_manifests():
        for name in (manifest.stem, manifest.name, manifest.short):
            assert find_manifest(name) == manifest


def test_a_manifest_of_ones_own_is_named_by_its_path(tmp_path: Path) -> None:
    (tmp_path / "tiny-1.toml").write_text(TINY_TOML)
    assert find_manifest(str(tmp_path / "tiny-1.toml")).stem == "tiny-1"
    edited = find_manifest("demo").toml.replace("network_crop = 224", "network_crop = 16")
    (tmp_path / "demo.toml").write_text(edited)
    with pytest.raises(ManifestError, match="the name of the released demo-1"):
        find_manifest(str(tmp_path / "demo.toml"))
    with pytest.raises(ManifestError, match="cannot read the manifest"):
        find_manifest("demo.toml")


def test_each_version_has_its_own_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert default_store(find_manifest("demo"), tmp_path) == tmp_path / "stores/demo-1.zarr"
    monkeypatch.setenv("DFDBENCH_CACHE", "elsewhere")
    assert default_store(find_manifest("realworld")) == Path("elsewhere/stores/realworld-1.zarr")


@pytest.mark.parametrize(
    ("name", "place"),
    [(name, False) for name in ("demo", "middlebury-third-1", "mine.toml", "sets/mine.toml")]
    + [(name, True) for name in ("mine.zarr", "./mine", "/sets/mine.zarr", "s3://bucket/a.zarr")],
)
def test_a_path_is_told_from_a_name(name: str, place: bool) -> None:
    assert is_place(name) is place


def test_a_set_of_ones_own_is_known_by_its_name_once_built(tmp_path: Path) -> None:
    assert own_stores(tmp_path) == {}
    stores = tmp_path / "stores"
    for name in ("lab-2", "lab-10", "lab-bench", "demo-1@noise-1", "demo-7", "lab-10.zarr.partial"):
        (stores / (name if "partial" in name else f"{name}.zarr")).mkdir(parents=True)
    assert own_stores(tmp_path) == {
        "demo-7": stores / "demo-7.zarr",
        "lab": stores / "lab-10.zarr",
        "lab-10": stores / "lab-10.zarr",
        "lab-2": stores / "lab-2.zarr",
        "lab-bench": stores / "lab-bench.zarr",
    }
    assert place_of("lab", tmp_path) == stores / "lab-10.zarr"
    assert place_of("elsewhere/lab.zarr", tmp_path) == "elsewhere/lab.zarr"
    assert place_of("demo", tmp_path) is None
    assert place_of("lab-10.toml", tmp_path) is None


@pytest.mark.parametrize("typed", ["demo@camera-2", "demo-1@camera-2"])
def test_a_set_on_a_track_is_the_same_but_for_its_name(typed: str) -> None:
    clean, tracked = find_manifest("demo"), find_manifest(typed)
    assert (tracked.stem, tracked.short) == ("demo-1@camera-2", "demo@camera-2")
    assert (tracked.degradation, tracked.on_track, clean.on_track) == ("camera-2", True, False)
    assert (tracked.sha256, tracked.name) == (clean.sha256, clean.name)
    assert tracked.pairs("test") == clean.pairs("test")
    assert find_manifest(tracked.short) == tracked


def test_it_has_a_place_of_its_own_but_the_files_of_the_clean_set(tmp_path: Path) -> None:
    clean, tracked = find_manifest("middlebury"), find_manifest("middlebury@law-1")
    assert default_store(tracked, tmp_path).name == "middlebury-third-1@law-1.zarr"
    assert tracked.file_stem == clean.file_stem
    assert lock_name(tracked) == lock_name(clean)


def test_a_manifest_of_one_s_own_has_tracks(tmp_path: Path) -> None:
    folder = tmp_path / "me@home"
    folder.mkdir()
    (folder / "tiny-1.toml").write_text(TINY_TOML)
    assert find_manifest(str(folder / "tiny-1.toml")).stem == "tiny-1"
    assert find_manifest(f"{folder / 'tiny-1.toml'}@gain-3").stem == "tiny-1@gain-3"
    assert not is_place(f"{folder / 'tiny-1.toml'}@gain-3")
    assert is_place(f"{folder}/tiny")
    assert is_place("tiny-1@gain-3.zarr")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("midlebury", "midlebury(?s:.*)did you mean middlebury"),
        ("demo@camra-2", "did you mean camera"),
        ("demo@camera-9", "did you mean camera-3"),
        ("demo@", "unknown track: nothing follows the @"),
        ("dmo@camera-2", "did you mean demo"),
        ("demo@camera-2@noise-1", r"(?s)one track at a time.*demo@camera-2 or demo@noise-1"),
        ("demo@../camera-2", "unknown data set"),
    ],
)
def test_near_misses_are_named(name: str, said: str) -> None:
    with pytest.raises(UnknownNameError, match=said):
        find_manifest(name)


def test_near_misses_of_splits_and_scenes_are_named() -> None:
    demo = find_manifest("demo")
    with pytest.raises(UnknownNameError, match=r"tset(?s:.*)did you mean test"):
        demo.pairs("tset")
    with pytest.raises(UnknownNameError, match=r"Atic(?s:.*)did you mean Attic"):
        demo.pairs("Atic")


@pytest.mark.parametrize("label", ["noise-1", "noise-0"])
def test_a_captured_set_refuses_and_says_so(label: str) -> None:
    with pytest.raises(InputError, match=f"(?s)captured.*realworld@{label}"):
        find_manifest(f"realworld@{label}")
