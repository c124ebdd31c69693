from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.building.build import build_store
from dfdbench.building.new_manifest import new_manifest
from dfdbench.building.sources import open_source
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import InputError
from tests.made_folder import SCENES, make_folder


def built(folder: Path, place: Path) -> Manifest:
    written = new_manifest(folder)
    manifest = parse_manifest(written.toml.encode(), written.name)
    report = build_store(manifest, open_source(manifest, folder), place)
    assert (report.problems, report.missing) == ((), ())
    return manifest


def test_what_it_writes_builds(tmp_path: Path) -> None:
    manifest = built(make_folder(tmp_path / "My desk"), tmp_path / "one.zarr")
    assert manifest.stem == "My-desk-1"
    assert manifest.scene_names == SCENES
    assert manifest.scenes_of("train") == SCENES[:3]
    assert manifest.scenes_of("test") == SCENES[3:]
    assert manifest.files is not None
    assert manifest.files.align != "none"
    assert manifest.depth.scale is not None


def test_names_that_are_no_scene_names_and_splits(tmp_path: Path) -> None:
    made = make_folder(tmp_path / "made")
    for number, scene in enumerate(SCENES):
        split = "train" if number < 3 else "test"
        for kind in ("sharp", "blurred", "depth"):
            place = tmp_path / "set" / kind / split / f"10:0{number % 3} {scene[0]}.png"
            place.parent.mkdir(parents=True, exist_ok=True)
            (made / scene / f"{kind}.png").rename(place)
    manifest = built(tmp_path / "set", tmp_path / "one.zarr")
    assert manifest.scenes[0].name == "10-00-s"
    assert manifest.scenes[0].names == {"split": "test", "file": "10:00 s"}
    assert len(manifest.scenes_of("train")) == 3


def test_mixed_endings_build(tmp_path: Path) -> None:
    # As in iDFD, whose folders hold .JPG beside .jpg.
    made = make_folder(tmp_path / "made")
    endings = (".JPG", ".jpg", ".png", ".jpg")
    for scene, ending in zip(SCENES, endings, strict=True):
        for kind in ("sharp", "blurred", "depth"):
            image = cv2.imread(str(made / scene / f"{kind}.png"), cv2.IMREAD_UNCHANGED)
            assert image is not None
            name = f"{scene}_0{'.png' if kind == 'depth' else ending}"
            place = tmp_path / "set" / kind / name
            place.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(place), image)
    manifest = built(tmp_path / "set", tmp_path / "one.zarr")
    assert manifest.files is not None
    assert (manifest.files.infocus, manifest.files.depth) == (
        "sharp/{scene}.*",
        "depth/{scene}.png",
    )
    assert len(manifest.scenes) == 4


def test_depth_in_one_split_only_is_split_by_number(tmp_path: Path) -> None:
    # As in ZEDD, whose test scenes have no depth.
    made = make_folder(tmp_path / "made")
    for scene in SCENES:
        depth = cv2.imread(str(made / scene / "depth.png"), cv2.IMREAD_UNCHANGED)
        assert depth is not None
        np.save(made / scene / "depth.npy", (depth / 1000).astype(np.float32))
        (made / scene / "depth.png").unlink()
        (tmp_path / "set/val").mkdir(parents=True, exist_ok=True)
        (made / scene).rename(tmp_path / "set/val" / scene)
    manifest = built(tmp_path / "set", tmp_path / "one.zarr")
    assert manifest.scenes_of("test") == SCENES[3:]
    assert manifest.scenes[0].names == {"split": "val"}


def test_files_paired_by_order_are_named_and_asked_about(tmp_path: Path) -> None:
    made = make_folder(tmp_path / "made")
    for number, scene in enumerate(SCENES):
        for step, kind in enumerate(("sharp", "blurred", "depth")):
            place = tmp_path / "set" / kind / f"{1000 * number + 7 * step}.png"
            place.parent.mkdir(parents=True, exist_ok=True)
            (made / scene / f"{kind}.png").rename(place)
    manifest = built(tmp_path / "set", tmp_path / "one.zarr")
    assert manifest.scenes[1].name == "scene-2"
    assert manifest.scenes[1].names["depth"] == "1014"
    assert any("by their order" in text for text in new_manifest(tmp_path / "set").open)


def test_a_folder_without_scenes_says_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        new_manifest(tmp_path / "none")
    (tmp_path / "one.png").touch()
    (tmp_path / "two.txt").touch()
    with pytest.raises(InputError, match="no scene with two photographs") as caught:
        new_manifest(tmp_path)
    assert caught.value.problems[0].got == "one.png; not read: 1 .txt"
