import os
import tracemalloc
from pathlib import Path

import pytest

from dfdbench.system.files import LARGEST_ARRAY, read_text, read_whole, write_whole


def test_a_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.json"
    write_whole(path, "old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.json"]


def test_a_file_that_cannot_be_written_is_told_by_its_own_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **where: object) -> None:
        raise PermissionError(13, "Permission denied", f"{where['dir']}/{where['prefix']}mmcn1sby")

    path = tmp_path / "t.tex"
    (tmp_path / "folder.tex").mkdir()
    with pytest.raises(IsADirectoryError) as replaced:
        write_whole(tmp_path / "folder.tex", "text")
    assert replaced.value.filename == str(tmp_path / "folder.tex")
    monkeypatch.setattr("tempfile.mkstemp", refused)
    with pytest.raises(PermissionError) as told:
        write_whole(path, "text")
    assert told.value.filename == str(path)


def test_what_is_no_regular_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "device").symlink_to("/dev/zero")
    for name in ("pipe", "device"):
        with pytest.raises(OSError, match="not a regular file"):
            read_whole(tmp_path / name)
    with pytest.raises(IsADirectoryError):
        read_whole(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_whole(tmp_path / "lacking")


def test_a_file_is_read_up_to_a_bound(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"ab\r\ncd")
    assert read_whole(path, 6) == b"ab\r\ncd"
    assert read_text(path) == "ab\ncd"
    with pytest.raises(OSError, match="larger than"):
        read_whole(path, 5)


def test_a_small_file_takes_little_memory_whatever_its_bound(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"ab")
    tracemalloc.start()
    try:
        assert read_whole(path, LARGEST_ARRAY) == b"ab"
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()
