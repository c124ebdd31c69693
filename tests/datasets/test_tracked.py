from pathlib import Path

import pytest

from dfdbench.building.fetching.checksums import lock_name
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.datasets.store_place import default_store, is_place
from dfdbench.datasets.tracked import with_track
from dfdbench.errors import InputError, ManifestError, UnknownNameError
from tests.conftest import TINY_TOML


@pytest.mark.parametrize("typed", ["demo@camera-2", "demo-1@camera-2"])
def test_a_set_on_a_track_is_the_same_but_for_its_name(typed: str) -> None:
    clean, tracked = find_manifest("demo"), find_manifest(typed)
    assert (tracked.stem, tracked.short) == ("demo-1@camera-2", "demo@camera-2")
    assert (tracked.degradation, tracked.on_track, clean.on_track) == ("camera-2", True, False)
    assert (tracked.sha256, tracked.name) == (clean.sha256, clean.name)
    assert tracked.pairs("test") == clean.pairs("test")
    assert find_manifest(tracked.short) == tracked


def test_severity_0_is_the_data_set_itself() -> None:
    assert find_manifest("middlebury@noise-0") == find_manifest("middlebury")


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
        ("demo@camra-2", "did you mean camera"),
        ("demo@camera-9", "did you mean camera-"),
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


@pytest.mark.parametrize("label", ["noise-1", "noise-0"])
def test_a_captured_set_refuses_and_says_so(label: str) -> None:
    with pytest.raises(InputError, match=f"(?s)captured.*realworld@{label}"):
        find_manifest(f"realworld@{label}")


def test_a_manifest_s_file_names_no_track() -> None:
    text = TINY_TOML.replace('degradation = "clean"', 'degradation = "camera-2"')
    with pytest.raises(ManifestError, match="degradation"):
        parse_manifest(text.encode(), "tiny-1.toml")
    tiny = parse_manifest(TINY_TOML.encode(), "tiny-1.toml")
    assert with_track(tiny, "camera-2").degradation == "camera-2"
