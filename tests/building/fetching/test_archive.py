from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import pytest

from dfdbench.building.fetching import archive
from dfdbench.building.fetching.archive import archive_members, read_member
from dfdbench.errors import SourceError


def made(path: Path, *names: str | zipfile.ZipInfo, content: bytes = b"content") -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name in names:
            file.writestr(name, content)
    return path


def test_members_and_their_content(tmp_path: Path) -> None:
    path = made(tmp_path / "Art-2views.zip", "Art/", "Art/view1.png", "Art/disp1.png")
    assert archive_members(path) == ("Art/view1.png", "Art/disp1.png")
    assert read_member(path, "Art/view1.png") == b"content"


def test_a_file_too_large_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = made(tmp_path / "a.zip", "a", content=bytes(1000))
    monkeypatch.setattr(archive, "_LARGEST", 999)
    with pytest.raises(SourceError, match="1000 bytes"):
        read_member(path, "a")


def test_a_bomb_that_lies_about_its_size_is_stopped(tmp_path: Path) -> None:
    path = made(tmp_path / "a.zip", "a", content=bytes(100_000))
    content = bytearray(path.read_bytes())
    # The size unpacked, in the directory at the end and in the member's own header.
    directory = content.rfind(b"PK\x01\x02")
    for place in (directory + 24, 22):
        content[place : place + 4] = struct.pack("<I", 10)
    path.write_bytes(bytes(content))
    assert archive_members(path) == ("a",)
    with pytest.raises(SourceError, match="damaged"):
        read_member(path, "a")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut short", b"<html>"])
def test_what_is_no_archive(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.zip").write_bytes(content)
    with pytest.raises(SourceError, match="not a zip archive"):
        archive_members(tmp_path / "a.zip")


def test_flipped_bytes_are_noticed(tmp_path: Path) -> None:
    path = made(tmp_path / "a.zip", "a", content=bytes(range(256)) * 40)
    content = bytearray(path.read_bytes())
    content[80] ^= 0xFF
    path.write_bytes(bytes(content))
    with pytest.raises(SourceError, match="damaged"):
        read_member(path, "a")


def test_only_what_is_stored_or_deflated_is_unpacked(tmp_path: Path) -> None:
    # What packs as LZMA or bzip2 may ask for any amount of memory.
    info = zipfile.ZipInfo("Art/view1.png")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as file:
        file.writestr(info, b"content", zipfile.ZIP_LZMA)
    with pytest.raises(SourceError, match="method 14"):
        read_member(tmp_path / "a.zip", "Art/view1.png")
