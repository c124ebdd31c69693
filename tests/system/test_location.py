from collections.abc import Callable
from pathlib import Path

import pytest
from upath import UPath

from dfdbench.errors import InputError
from dfdbench.system import location


def fill(folder: UPath, content: bytes = b"12345") -> None:
    for name in ("zarr.json", "Art/zarr.json", "Art/depth/c/0"):
        place = folder / name
        if location.is_local(folder):
            Path(place.path).parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)


def test_folders_are_copied_moved_and_removed(place: Callable[[str], UPath]) -> None:
    first, second = place("first"), place("second")
    assert not location.exists(first)
    fill(first)
    assert location.exists(first)
    assert (location.folders_in(first), location.size_of(first)) == (("Art",), 15)
    location.copy_folder(first / "Art", second / "Art", "zarr.json")
    assert (second / "Art/depth/c/0").read_bytes() == b"12345"
    fill(second, b"an older one")
    location.move_folder(first, second, "zarr.json")
    assert not location.exists(first)
    assert location.size_of(second) == 15
    location.remove(second)
    assert not location.exists(second)
    location.remove(second)


def test_places_that_cannot_be_reached() -> None:
    with pytest.raises(InputError, match="cannot reach places of this kind"):
        location.as_location("github://x/a.zarr")
    with pytest.raises(InputError, match="names no folder"):
        location.as_location("memory://")
    with pytest.raises(InputError, match="cannot reach the host"):
        location.as_location("ftp://nowhere.invalid/a.zarr")


def test_file_urls_are_local(tmp_path: Path) -> None:
    assert location.is_local(location.as_location(f"file://{tmp_path}/a.zarr"))
    path = tmp_path / "a.zarr"
    assert location.as_location(path) == location.as_location(str(path))
