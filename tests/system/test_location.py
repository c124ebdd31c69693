from collections.abc import Callable
from pathlib import Path

import pytest
from upath import UPath

from dfdbench.errors import InputError
from dfdbench.system.location import (
    as_location,
    copy_folder,
    exists,
    folders_in,
    is_local,
    move_folder,
    remove,
    size_of,
)


def fill(location: UPath, content: bytes = b"12345") -> None:
    for name in ("zarr.json", "Art/zarr.json", "Art/depth/c/0"):
        place = location / name
        if is_local(location):
            Path(place.path).parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)


def test_folders_are_copied_moved_and_removed(place: Callable[[str], UPath]) -> None:
    first, second = place("first"), place("second")
    assert not exists(first)
    fill(first)
    assert exists(first)
    assert folders_in(first) == ("Art",)
    assert size_of(first) == 15
    copy_folder(first / "Art", second / "Art", "zarr.json")
    assert (second / "Art/depth/c/0").read_bytes() == b"12345"
    fill(second, b"an older one")
    move_folder(first, second, "zarr.json")
    assert not exists(first)
    assert size_of(second) == 15
    remove(second)
    assert not exists(second)
    remove(second)


def test_places_that_cannot_be_reached() -> None:
    with pytest.raises(InputError, match="nosuch"):
        as_location("nosuch://bucket/a.zarr")
    for needs_more in ("reference://x", "dir://x", "github://x/a.zarr"):
        with pytest.raises(InputError, match="cannot reach places of this kind"):
            as_location(needs_more)
    with pytest.raises(InputError, match="names no folder"):
        as_location("memory://")
    with pytest.raises(InputError, match="cannot reach the host"):
        as_location("ftp://nowhere.invalid/a.zarr")


def test_file_urls_are_local(tmp_path: Path) -> None:
    assert is_local(as_location(f"file://{tmp_path}/a.zarr"))
    assert as_location(tmp_path / "a.zarr") == as_location(str(tmp_path / "a.zarr"))
