"""Captured sets that their manifest describes: whole, in part, and not at all."""

import hashlib
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.blur.light import decode
from dfdbench.board.row_file import known_fingerprints
from dfdbench.building.build import build_store
from dfdbench.building.fetching import known_checksums
from dfdbench.building.sources import SceneError, open_source
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import SourceError
from dfdbench.system.parallel import Threads
from tests.made_folder import FOLDER_TOML, make_folder


def manifest_of(text: str = FOLDER_TOML) -> Manifest:
    return parse_manifest(text.encode(), "mine-1.toml")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_folder(tmp_path / "captures")


def test_scenes_with_several_captures_share_a_depth_map(folder: Path) -> None:
    text = FOLDER_TOML.replace("capture", "aperture").replace("[1]", "[2, 4]")
    text = text.replace("blurred.png", "f{aperture}.png").replace("pairs = 2", "pairs = 4")
    manifest = manifest_of(text.replace("pair_count = 4", "pair_count = 8"))
    for scene in manifest.scene_names:
        image = np.asarray(cv2.imread(str(folder / scene / "blurred.png")))
        for number in (2, 4):
            cv2.imwrite(str(folder / scene / f"f{number}.png"), image + np.uint8(number))
    images = open_source(manifest, folder).read("desk")
    assert (images.defocus[1] == images.defocus[0] + 2).all()
    assert images.depth.shape == images.infocus.shape[1:3]


def test_a_flat_field_gives_the_defocus_image_back_its_corners(folder: Path) -> None:
    halved = "[[1.0, 0.5], [1.0, 0.5], [1.0, 1.0]]"
    plain = open_source(manifest_of(), folder).read("desk")
    text = FOLDER_TOML.replace("[table]", f"flat_field = {halved}\n\n[table]")
    even = open_source(manifest_of(text), folder).read("desk")
    assert np.array_equal(even.infocus, plain.infocus)
    before, after = (decode(images.defocus[0, 0, 0].astype(float)) for images in (plain, even))
    seen = before < 0.45
    times = np.array([2, 2, 1])
    assert after[seen] == pytest.approx((times * before)[seen], rel=0.03)


def test_patterns_that_match_nothing_say_what_is_there(folder: Path) -> None:
    text = FOLDER_TOML.replace("{scene}/sharp.png", "{scene}/infocus.png")
    with pytest.raises(
        SourceError, match=r"no file matches files.infocus, .*, as desk/infocus.png"
    ) as caught:
        open_source(manifest_of(text), folder)
    (problem,) = caught.value.problems
    assert "desk/blurred.png" in problem.got
    with pytest.raises(SourceError, match="no such folder"):
        open_source(manifest_of(), folder / "nowhere")


def test_a_pattern_may_leave_the_ending_open(folder: Path) -> None:
    text = FOLDER_TOML.replace("sharp.png", "sharp.*")
    known = open_source(manifest_of(text), folder).read("desk")
    (folder / "door/sharp.png").rename(folder / "door/sharp.PNG")
    source = open_source(manifest_of(text), folder)
    assert source.signature("desk") == open_source(manifest_of(), folder).signature("desk")
    assert source.read("door").infocus.shape == known.infocus.shape
    (folder / "lamp/sharp.png").unlink()
    (folder / "lamp/sharp.txt").touch()
    shutil.copy(folder / "shelf/sharp.png", folder / "shelf/sharp.jpg")
    source = open_source(manifest_of(text), folder)
    with pytest.raises(SceneError, match="a file is missing"):
        source.signature("lamp")
    for step in (source.signature, source.read):
        with pytest.raises(SceneError, match=r"the pattern: shelf/sharp\.jpg, shelf/sharp\.png \("):
            step("shelf")


def test_a_clone_may_be_named_or_the_set_in_it(tmp_path: Path) -> None:
    make_folder(tmp_path / "data/mine")
    text = FOLDER_TOML.replace("[files]", '[files]\ninside = "data/mine"')
    for named in (tmp_path, tmp_path / "data/mine"):
        assert open_source(manifest_of(text), named).signature("desk")


def test_a_file_that_is_not_the_one_known_is_refused(folder: Path) -> None:
    right = hashlib.sha256((folder / "desk/sharp.png").read_bytes()).hexdigest()
    known = {"desk/desk/sharp.png": right, "door/door/sharp.png": right}
    source = open_source(manifest_of(), folder, known)
    assert source.signature("desk")
    with pytest.raises(SceneError, match="not the file of this data set"):
        source.signature("door")


@pytest.fixture
def dfd_indoor(shared_data: Path) -> Path:
    folder = shared_data / "dfd_indoor"
    if not folder.is_dir():
        pytest.skip("no copy of DFD indoor beside the shared Middlebury images")
    return folder


def test_dfd_indoor_is_what_its_manifest_says(dfd_indoor: Path) -> None:
    manifest = find_manifest("dfd-indoor")
    source = open_source(manifest, dfd_indoor, known_checksums(manifest))
    assert all(len(source.signature(scene)) == 64 for scene in manifest.scene_names)
    images = source.read("test-03")
    found = images.found["test-03/capture1"]
    assert images.depth.shape == (432, 645)
    assert found["correlation"] > 0.99
    assert images.valid.mean() > 0.98


@pytest.mark.slow
def test_the_fingerprint_of_dfd_indoor(dfd_indoor: Path, tmp_path: Path) -> None:
    manifest = find_manifest("dfd-indoor")
    source = open_source(manifest, dfd_indoor, known_checksums(manifest))
    report = build_store(manifest, source, tmp_path / "dfd.zarr", pool=Threads(2))
    board = Path(__file__).parents[3] / "leaderboard"
    assert report.fingerprint in known_fingerprints(board)["dfd-indoor-1"]
    assert (report.pairs, report.problems, report.warnings) == (110, (), ())
