from __future__ import annotations

import stat
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
    assert archive_members(path) == {"Art/view1.png": 7, "Art/disp1.png": 7}
    assert read_member(path, "Art/view1.png") == b"content"


@pytest.mark.parametrize(
    "name", ["../escaped.png", "/etc/escaped.png", "Art/../../escaped.png", "..\\escaped", "C:/x"]
)
def test_names_that_lead_out_are_refused(tmp_path: Path, name: str) -> None:
    path = made(tmp_path / "a.zip", "Art/view1.png", name)
    with pytest.raises(SourceError, match="leads out of it"):
        archive_members(path)


def test_links_are_refused(tmp_path: Path) -> None:
    link = zipfile.ZipInfo("Art/view1.png")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with pytest.raises(SourceError, match="holds a link"):
        archive_members(made(tmp_path / "a.zip", link, content=b"/etc/passwd"))


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_the_same_name_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="twice"):
        archive_members(made(tmp_path / "a.zip", "Art/view1.png", "Art/view1.png"))


def test_bombs_are_refused_by_the_sizes_they_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made(tmp_path / "a.zip", "a", "b", content=bytes(1000))
    monkeypatch.setattr(archive, "_LARGEST_MEMBER", 999)
    with pytest.raises(SourceError, match="1000 bytes"):
        archive_members(path)
    monkeypatch.setattr(archive, "_LARGEST_MEMBER", 1000)
    monkeypatch.setattr(archive, "_LARGEST_WHOLE", 1999)
    with pytest.raises(SourceError, match="2000 bytes in 2 files"):
        archive_members(path)
    monkeypatch.setattr(archive, "_LARGEST_WHOLE", 2000)
    assert len(archive_members(path)) == 2
    monkeypatch.setattr(archive, "_MOST_MEMBERS", 1)
    with pytest.raises(SourceError, match="too much"):
        archive_members(path)


def test_a_bomb_that_lies_about_its_size_is_stopped(tmp_path: Path) -> None:
    path = made(tmp_path / "a.zip", "a", content=bytes(100_000))
    content = bytearray(path.read_bytes())
    # The size unpacked, in the directory at the end and in the member's own header.
    directory = content.rfind(b"PK\x01\x02")
    for place in (directory + 24, 22):
        content[place : place + 4] = struct.pack("<I", 10)
    path.write_bytes(bytes(content))
    assert archive_members(path) == {"a": 10}
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


def test_a_file_without_a_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="a file without a name"):
        archive_members(made(tmp_path / "a.zip", zipfile.ZipInfo("")))


def test_only_what_is_stored_or_deflated_is_unpacked(tmp_path: Path) -> None:
    # What packs as LZMA or bzip2 may ask for any amount of memory.
    info = zipfile.ZipInfo("Art/view1.png")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as file:
        file.writestr(info, b"content", zipfile.ZIP_LZMA)
    with pytest.raises(SourceError, match="method 14, and not deflated"):
        archive_members(tmp_path / "a.zip")


def test_too_many_members_are_counted_before_each_is_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made(tmp_path / "a.zip", *map(str, range(50)))
    monkeypatch.setattr(archive, "_MOST_MEMBERS", 49)
    monkeypatch.setattr(archive, "_fault", lambda *given: pytest.fail("looked at"))
    with pytest.raises(SourceError, match="in 50 files"):
        archive_members(path)
