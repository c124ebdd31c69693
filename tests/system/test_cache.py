import errno
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from dfdbench.errors import InputError, StoreError
from dfdbench.system.cache import cache_entries, cache_folder, remove_entries


def test_where_the_cache_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path / "named"))
    assert cache_folder() == tmp_path / "named"
    # No shell has seen what a file of variables or a container says.
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("DFDBENCH_CACHE", "~/cache")
    assert cache_folder() == tmp_path / "cache"
    monkeypatch.setenv("DFDBENCH_CACHE", "~nosuch/x")
    with pytest.raises(InputError, match="no such home folder: ~nosuch/x"):
        cache_folder()
    monkeypatch.delenv("DFDBENCH_CACHE")
    assert "dfdbench" in str(cache_folder())


@pytest.mark.parametrize("address", ["s3://bucket/cache", "file:///tmp/cache"])
def test_an_address_is_no_cache(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    with pytest.raises(InputError, match="--cache"):
        cache_folder(Path(address))
    monkeypatch.setenv("DFDBENCH_CACHE", address)
    with pytest.raises(InputError, match="DFDBENCH_CACHE") as said:
        cache_folder()
    assert address in said.value.problems[0].what


def test_what_is_in_it_and_removal(tmp_path: Path) -> None:
    assert cache_entries(tmp_path) == ()
    for name, size in {"downloads/a/x/1": 5, "downloads/a/2": 6, "stores/b.zarr/c": 7}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(bytes(size))
    (tmp_path / "mine").mkdir()
    first, second = cache_entries(tmp_path)
    assert (first.kind, first.name, first.files, first.size) == ("downloads", "a", 2, 11)
    remove_entries((first,))
    assert cache_entries(tmp_path) == (second,)
    assert (tmp_path / "mine").exists()


def test_a_stopped_removal_leaves_no_half_of_a_store(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    store = tmp_path / "stores/b.zarr"
    (store / "c").mkdir(parents=True)
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "rmtree", _stopped)
        with pytest.raises(KeyboardInterrupt):
            remove_entries(cache_entries(tmp_path))
    assert not store.exists()
    assert [entry.stem for entry in cache_entries(tmp_path)] == ["b"]
    # Built again, removed again: nothing is left of either.
    for again in (store / "c", store.with_name(".b.zarr.removed") / "c"):
        again.mkdir(parents=True, exist_ok=True)
        remove_entries(cache_entries(tmp_path)[-1:])
        assert list(store.parent.iterdir()) == []


def test_what_cannot_be_removed_is_told_and_the_others_are_removed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("a", "b"):
        (tmp_path / f"stores/{name}.zarr").mkdir(parents=True)
    whole = Path.rename

    def rename(path: Path, target: Path) -> Path:
        if path.name == "a.zarr":
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return whole(path, target)

    monkeypatch.setattr(Path, "rename", rename)
    with pytest.raises(StoreError, match=r"Permission denied \(.*a\.zarr\)$"):
        remove_entries(cache_entries(tmp_path))
    assert [entry.name for entry in cache_entries(tmp_path)] == ["a.zarr"]


def test_a_folder_that_goes_away_meanwhile_is_not_counted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("kept", "gone"):
        (tmp_path / "stores/a.zarr" / name).mkdir(parents=True)
        (tmp_path / "stores/a.zarr" / name / "c").write_bytes(bytes(5))
    # It is there and cannot be read, as what others removed from a network's disk.
    (tmp_path / "stores/a.zarr/loop").symlink_to("loop")
    whole = os.scandir

    def scandir(path: str | Path) -> Any:
        if str(path).endswith("gone"):
            raise FileNotFoundError(errno.ENOENT, "No such file or directory", str(path))
        return whole(path)

    monkeypatch.setattr(os, "scandir", scandir)
    (entry,) = cache_entries(tmp_path)
    assert (entry.files, entry.size) == (1, 5)


def test_of_a_store_that_lies_elsewhere_the_link_alone_is_removed(tmp_path: Path) -> None:
    (tmp_path / "disk" / "c").mkdir(parents=True)
    (tmp_path / "cache/stores").mkdir(parents=True)
    (tmp_path / "cache/stores/a.zarr").symlink_to(tmp_path / "disk")
    remove_entries(cache_entries(tmp_path / "cache"))
    assert not list((tmp_path / "cache/stores").iterdir())
    assert (tmp_path / "disk/c").is_dir()


def _stopped(path: Path, ignore_errors: bool = False) -> None:
    if not ignore_errors:
        raise KeyboardInterrupt
