"""The site's layout served on the loopback, with what can go wrong on the way."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from dfdbench.building.build import build_store
from dfdbench.building.fetching.checksums import known_checksums
from dfdbench.building.fetching.download import Patience
from dfdbench.building.sources import open_source
from dfdbench.building.sources.middlebury_download import Download, download_middlebury
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import SourceError
from tests.conftest import TINY_DEFAULT_TOML, TINY_TOML
from tests.site import Site, served

BELOW = "data/scenes/ThirdSize"
QUICK = Patience(tries=4, pause=0.01, silence=0.5)
FILES = 6 + 11  # depth maps and images of the tiny set


@pytest.fixture
def site(tiny_folder: Path, tmp_path: Path) -> Iterator[Site]:
    place = tmp_path / "server" / BELOW
    place.parent.mkdir(parents=True)
    tiny_folder.rename(place)
    with served(tmp_path / "server") as site:
        yield site


@pytest.fixture
def manifest(site: Site) -> Manifest:
    text = TINY_TOML.replace("https://example.org/tiny", f"{site.address}/{BELOW}")
    return parse_manifest(text.encode(), "tiny-1.toml")


def fingerprint(manifest: Manifest, done: Download, tmp_path: Path) -> str:
    known = known_checksums(manifest, done.folder)
    source = open_source(manifest, done.folder, checksums=known)
    return build_store(manifest, source, tmp_path / "built.zarr").fingerprint


@pytest.fixture
def reference(manifest: Manifest, site: Site, tmp_path: Path) -> str:
    source = open_source(manifest, site.folder / BELOW)
    return build_store(manifest, source, tmp_path / "reference.zarr").fingerprint


def test_everything_comes_and_later_builds_ask_nobody(
    manifest: Manifest, site: Site, reference: str, tmp_path: Path
) -> None:
    done = download_middlebury(manifest, tmp_path / "in", patience=QUICK)
    assert (done.new, done.kept, done.missing) == (FILES, 0, ())
    assert done.lock == tmp_path / "in/tiny-1.lock"
    assert len(done.lock.read_text().splitlines()) == FILES
    check = ["sha256sum", "--check", "--quiet", done.lock.name]
    assert subprocess.run(check, cwd=done.folder, check=False).returncode == 0
    assert fingerprint(manifest, done, tmp_path) == reference
    asked = len(site.requests)
    again = download_middlebury(manifest, tmp_path / "in", offline=True)
    assert (again.new, again.kept, again.lock) == (0, FILES, None)
    assert len(site.requests) == asked


def test_all_that_mends_itself(
    manifest: Manifest, site: Site, reference: str, tmp_path: Path
) -> None:
    faults = {
        "One/disp1.png": ["500", "500"],
        "One/Illum1/Exp0/view1.png": ["truncate"],
        "Two/Illum1/Exp1/view5.png": ["wrong"],
        "Two/disp5.png": ["stall"],
        "Three/Illum1/Exp0/view1.png": ["redirect"],
        "Three/Illum1/Exp0/view5.png": ["truncate", "503", "stall"],
    }
    for name, listed in faults.items():
        site.faults[f"/{BELOW}/{name}"] = list(listed)
    done = download_middlebury(manifest, tmp_path / "in", patience=QUICK)
    assert done.new == FILES
    assert fingerprint(manifest, done, tmp_path) == reference
    for name, listed in faults.items():
        assert site.asked_for(f"/{BELOW}/{name}") == len(listed) + 1
    aside = [path for path in (tmp_path / "in/set-aside").rglob("*") if path.is_file()]
    assert [path.name.split(".")[0] for path in aside] == ["view5"]


def test_missing_and_damaged_are_told_in_one_report(
    manifest: Manifest, site: Site, tmp_path: Path
) -> None:
    site.faults[f"/{BELOW}/One/Illum1/Exp0/view1.png"] = ["404"]
    site.faults[f"/{BELOW}/Two/disp1.png"] = ["wrong"] * 9
    site.faults[f"/{BELOW}/Two/Illum1/Exp0/view5.png"] = ["500"] * 99
    with pytest.raises(SourceError) as caught:
        download_middlebury(manifest, tmp_path / "in", patience=QUICK)
    said = [problem.what for problem in caught.value.problems]
    assert said == [
        "not a PNG file",
        "the server does not send the file",
        "1 damaged files in all, set aside; the other 14 are whole and kept",
        "no address has these 1 files: One/Illum1/Exp0/view1.png",
    ]
    assert "One/Illum1/Exp0/view1.png" in str(caught.value)
    site.faults.clear()
    assert download_middlebury(manifest, tmp_path / "in", patience=QUICK).new == 3


def test_an_image_of_another_size_than_its_depth_map_is_refused(
    manifest: Manifest, site: Site, tmp_path: Path
) -> None:
    other = site.folder / BELOW / "Two/Illum1/Exp0/view1.png"
    (site.folder / BELOW / "One/Illum1/Exp0/view1.png").write_bytes(other.read_bytes())
    with pytest.raises(SourceError, match="size differs"):
        download_middlebury(manifest, tmp_path / "in", patience=QUICK)


def test_the_lock_file_is_held_to(manifest: Manifest, site: Site, tmp_path: Path) -> None:
    done = download_middlebury(manifest, tmp_path / "in", patience=QUICK)
    image = done.folder / "One/Illum1/Exp0/view1.png"
    right = image.read_bytes()
    image.write_bytes((done.folder / "One/Illum1/Exp1/view1.png").read_bytes())
    with pytest.raises(SourceError, match="not the file of this data set"):
        fingerprint(manifest, done, tmp_path)
    assert download_middlebury(manifest, tmp_path / "in", patience=QUICK).new == 1
    assert image.read_bytes() == right
    # A file that the site has changed since is refused as well.
    image.unlink()
    served_ = site.folder / BELOW / "One/Illum1/Exp0/view1.png"
    served_.write_bytes((done.folder / "One/Illum1/Exp1/view1.png").read_bytes())
    with pytest.raises(SourceError, match="not the file of this data set"):
        download_middlebury(manifest, tmp_path / "in", patience=QUICK)


def test_an_incomplete_download_locks_nothing(
    manifest: Manifest, site: Site, tmp_path: Path
) -> None:
    site.faults[f"/{BELOW}/One/Illum1/Exp0/view1.png"] = ["404"]
    done = download_middlebury(manifest, tmp_path / "in", patience=QUICK)
    assert done.missing == ("One/Illum1/Exp0/view1.png",)
    assert done.lock is None
    assert not (tmp_path / "in/tiny-1.lock").exists()


def test_a_mirror_stands_for_the_site(
    manifest: Manifest, site: Site, reference: str, tmp_path: Path
) -> None:
    with served(tmp_path / "server/data") as mirror:
        done = download_middlebury(manifest, tmp_path / "in", [mirror.address], patience=QUICK)
        assert len(mirror.requests) == FILES
    assert site.requests == []
    assert fingerprint(manifest, done, tmp_path) == reference


def test_a_mirror_without_the_files_is_named(
    manifest: Manifest, site: Site, tmp_path: Path
) -> None:
    wrong = f"{site.address}/nothing"
    done = download_middlebury(manifest, tmp_path / "in", [wrong], patience=QUICK)
    assert done.new == FILES
    (said,) = done.lacking
    assert f"the mirror lacks {FILES} files, such as 404 {wrong}/" in said.what
    # Kept files are not asked for, and say nothing of the mirror.
    again = download_middlebury(manifest, tmp_path / "in", [wrong], patience=QUICK)
    assert again.lacking == ()
    site.faults[f"/{BELOW}/One/disp1.png"] = ["500"] * 99
    with pytest.raises(SourceError) as caught:
        download_middlebury(manifest, tmp_path / "other", [wrong], patience=QUICK)
    assert caught.value.problems[-1].where == wrong


@pytest.fixture
def default(site: Site) -> Manifest:
    """The tiny set in the site's default lighting alone."""
    text = TINY_DEFAULT_TOML.replace("https://example.org/tiny", f"{site.address}/{BELOW}")
    return parse_manifest(text.encode(), "tiny-1.toml")


def archives(site: Site) -> Path:
    """The default lighting of each scene, in an archive and beside it, as the site has it."""
    place = site.folder / BELOW / "zip-2views"
    place.mkdir()
    for scene in ("One", "Two", "Three"):
        folder = site.folder / BELOW / scene
        with zipfile.ZipFile(place / f"{scene}-2views.zip", "w") as file:
            for view in (1, 5):
                shutil.copy(folder / f"Illum1/Exp1/view{view}.png", folder / f"view{view}.png")
                for name in (f"disp{view}.png", f"view{view}.png"):
                    file.write(folder / name, f"{scene}/{name}")
    return place


def test_default_lighting_comes_in_archives(default: Manifest, site: Site, tmp_path: Path) -> None:
    archives(site)
    done = download_middlebury(default, tmp_path / "in", patience=QUICK)
    assert done.new == len(site.requests) == 3
    zips = build_store(default, open_source(default, done.folder), tmp_path / "zips.zarr")
    files = open_source(default, site.folder / BELOW)
    assert zips.pairs == 6
    assert zips.fingerprint == build_store(default, files, tmp_path / "files.zarr").fingerprint
    again = download_middlebury(default, tmp_path / "in", offline=True)
    assert (again.new, again.kept, again.missing) == (0, 3, ())


def test_what_is_no_archive_is_set_aside_and_its_files_come_one_by_one(
    default: Manifest, site: Site, tmp_path: Path
) -> None:
    (archives(site) / "Two-2views.zip").write_bytes(b"<html>")
    done = download_middlebury(default, tmp_path / "in", patience=QUICK)
    assert done.new == 2 + 4
    aside = [path.name for path in (tmp_path / "in/set-aside").rglob("*") if path.is_file()]
    assert len(aside) == 1
    assert aside[0].startswith("Two-2views.zip.")
    source = open_source(default, done.folder)
    assert build_store(default, source, tmp_path / "a.zarr").pairs == 6


def test_archives_on_disk_are_a_source(default: Manifest, site: Site) -> None:
    source = open_source(default, archives(site).parent / "zip-2views")
    assert len(source.available_pairs()) == 6
