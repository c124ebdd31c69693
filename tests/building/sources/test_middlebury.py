import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dfdbench.building.build import build_store
from dfdbench.building.fetching import known_checksums
from dfdbench.building.sources import middlebury, open_source
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import SourceError
from tests.building.test_fetching import archive
from tests.conftest import BELOW, TINY_DEFAULT_TOML, served_by, write_png
from tests.site import Site

pytestmark = pytest.mark.usefixtures("impatient")


def test_images_are_rgb_and_zero_is_unknown(tiny_manifest: Manifest, tiny_folder: Path) -> None:
    red = np.zeros((24, 30, 3), np.uint8)
    red[..., 2] = 255  # OpenCV writes blue first
    write_png(tiny_folder / "One/Illum1/Exp0/view1.png", red)
    depth = np.full((24, 30), 90, np.uint8)
    depth[0, 0] = 91
    depth[3, 4] = 0
    write_png(tiny_folder / "One/disp1.png", depth)
    images = middlebury.MiddleburyScenes(tiny_manifest, tiny_folder).read("One")
    assert images.infocus[0, 0, 0, 5, 5].tolist() == [255, 0, 0]
    assert np.isnan(images.depth[0, 3, 4])
    assert np.argwhere(~images.valid[0]).tolist() == [[3, 4]]


def test_a_folder_without_scenes(tiny_manifest: Manifest, tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no scene found"):
        middlebury.MiddleburyScenes(tiny_manifest, tmp_path)
    with pytest.raises(SourceError, match="no such folder"):
        middlebury.MiddleburyScenes(tiny_manifest, tmp_path / "none")


@pytest.mark.parametrize("top", ["", "Third/"])
def test_a_folders_file_comes_before_an_archives(tmp_path: Path, top: str) -> None:
    packed = archive(
        tmp_path / "One-2views.zip",
        {f"{top}One/view1.png": b"packed", f"{top}One/view5.png": b"packed too"},
    )
    (tmp_path / "One").mkdir()
    (tmp_path / "One/view1.png").write_bytes(b"unpacked")
    files = middlebury.SceneFiles("One", tmp_path / "One", packed)
    assert (files.read("view1.png"), files.read("view5.png")) == (b"unpacked", b"packed too")
    assert files.where("view1.png") == str(tmp_path / "One/view1.png")
    assert files.where("view5.png") == f"{packed}, view5.png"
    assert not files.has("disp1.png")
    with pytest.raises(SourceError, match="no such file") as caught:
        files.read("disp1.png")
    assert caught.value.problems[0].where == f"{packed}, disp1.png"


@pytest.mark.parametrize("above", ["", "ThirdSize", "scenes2005/ThirdSize"])
@pytest.mark.parametrize("below", ["", "zip-2views"])
def test_scenes_are_found_in_the_sites_layout(tmp_path: Path, above: str, below: str) -> None:
    assert middlebury.find_scene("One", "scenes2005", tmp_path) is None
    packed = archive(tmp_path / above / below / "One-2views.zip", {"One/view1.png": b"x"})
    found = middlebury.find_scene("One", "scenes2005", tmp_path)
    assert found == middlebury.SceneFiles("One", None, packed)
    assert found.has("view1.png")
    (tmp_path / above / "One").mkdir()
    both = middlebury.find_scene("One", "scenes2005", tmp_path)
    assert both == middlebury.SceneFiles("One", tmp_path / above / "One", packed)
    assert middlebury.find_scene("Two", "scenes2005", tmp_path) is None


FILES = 6 + 11  # depth maps and images of the tiny set


@pytest.fixture
def manifest(site: Site) -> Manifest:
    return parse_manifest(served_by(site).encode(), "tiny-1.toml")


def fingerprint(manifest: Manifest, done: middlebury.Download, tmp_path: Path) -> str:
    known = known_checksums(manifest, done.folder)
    source = open_source(manifest, done.folder, checksums=known)
    return build_store(manifest, source, tmp_path / "built.zarr").fingerprint


def test_missing_and_damaged_are_told(manifest: Manifest, site: Site, tmp_path: Path) -> None:
    site.faults[f"/{BELOW}/One/Illum1/Exp0/view1.png"] = ["404"]
    site.faults[f"/{BELOW}/Two/disp1.png"] = ["wrong"] * 9
    site.faults[f"/{BELOW}/Two/Illum1/Exp0/view5.png"] = ["500"] * 99
    with pytest.raises(SourceError) as caught:
        middlebury.download_middlebury(manifest, tmp_path / "in")
    said = [problem.what for problem in caught.value.problems]
    assert said == [
        "not a PNG file",
        "the server does not send the file",
        "1 damaged files in all, set aside; the other 14 are whole and kept",
        "no address has these 1 files: One/Illum1/Exp0/view1.png",
        f"1 file set aside in {tmp_path / 'in/set-aside'}",
    ]
    # Without one that is nowhere it is a set that lacks pairs: nothing is locked.
    site.faults.clear()
    site.faults[f"/{BELOW}/One/Illum1/Exp0/view1.png"] = ["404"]
    done = middlebury.download_middlebury(manifest, tmp_path / "in")
    assert (done.new, done.kept, done.lock) == (2, FILES - 3, None)
    assert not (tmp_path / "in/tiny-1.lock").exists()
    assert middlebury.download_middlebury(manifest, tmp_path / "in").new == 1


def test_the_lock_file_is_held_to(manifest: Manifest, site: Site, tmp_path: Path) -> None:
    done = middlebury.download_middlebury(manifest, tmp_path / "in")
    assert (done.new, done.kept, done.lock) == (FILES, 0, tmp_path / "in/tiny-1.lock")
    check = ["sha256sum", "--check", "--quiet", "tiny-1.lock"]
    assert subprocess.run(check, cwd=done.folder, check=False).returncode == 0
    image = done.folder / "One/Illum1/Exp0/view1.png"
    right = image.read_bytes()
    image.write_bytes((done.folder / "One/Illum1/Exp1/view1.png").read_bytes())
    with pytest.raises(SourceError, match="not the file of this data set"):
        fingerprint(manifest, done, tmp_path)
    assert middlebury.download_middlebury(manifest, tmp_path / "in").new == 1
    assert image.read_bytes() == right
    # A file that the site has changed since is refused as well.
    image.unlink()
    served_ = site.folder / BELOW / "One/Illum1/Exp0/view1.png"
    served_.write_bytes((done.folder / "One/Illum1/Exp1/view1.png").read_bytes())
    with pytest.raises(SourceError, match="not the file of this data set"):
        middlebury.download_middlebury(manifest, tmp_path / "in")


def test_a_mirror_without_files_is_named(manifest: Manifest, site: Site, tmp_path: Path) -> None:
    wrong = f"{site.address}/nothing"
    done = middlebury.download_middlebury(manifest, tmp_path / "in", [wrong])
    assert done.new == FILES
    (said,) = done.lacking
    assert f"the mirror lacks {FILES} files, such as 404 {wrong}/" in said.what
    # Kept files are not asked for, and say nothing of the mirror.
    assert middlebury.download_middlebury(manifest, tmp_path / "in", [wrong]).lacking == ()
    site.faults[f"/{BELOW}/One/disp1.png"] = ["500"] * 99
    with pytest.raises(SourceError) as caught:
        middlebury.download_middlebury(manifest, tmp_path / "other", [wrong])
    assert caught.value.problems[-1].where == wrong


@pytest.fixture
def default(site: Site) -> Manifest:
    """The tiny set in the site's default lighting alone."""
    return parse_manifest(served_by(site, TINY_DEFAULT_TOML).encode(), "tiny-1.toml")


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
    done = middlebury.download_middlebury(default, tmp_path / "in")
    assert done.new == len(site.requests) == 3
    zips = build_store(default, open_source(default, done.folder), tmp_path / "zips.zarr")
    files = open_source(default, site.folder / BELOW)
    assert zips.pairs == 6
    assert zips.fingerprint == build_store(default, files, tmp_path / "files.zarr").fingerprint
    again = middlebury.download_middlebury(default, tmp_path / "in", offline=True)
    assert (again.new, again.kept) == (0, 3)


def test_what_is_no_archive_is_set_aside_and_its_files_come_one_by_one(
    default: Manifest, site: Site, tmp_path: Path
) -> None:
    (archives(site) / "Two-2views.zip").write_bytes(b"<html>")
    done = middlebury.download_middlebury(default, tmp_path / "in")
    assert done.new == 2 + 4
    (aside,) = (path for path in (tmp_path / "in/set-aside").rglob("*") if path.is_file())
    assert aside.name.startswith("Two-2views.zip.")
    assert build_store(default, open_source(default, done.folder), tmp_path / "a.zarr").pairs == 6
