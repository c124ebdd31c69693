from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.building.build import build_store
from dfdbench.building.new_manifest import new_manifest, with_found_scenes
from dfdbench.building.sources import open_source
from dfdbench.datasets.catalog import find_manifest, manifest_in, with_track
from dfdbench.datasets.croissant import datasheet_of
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import InputError, SourceError, StoreError
from dfdbench.evaluation.fitting import training_scenes
from tests.made_folder import SCENES, built, make_folder, rearranged


def test_names_that_are_no_scene_names_and_splits(tmp_path: Path) -> None:
    def name(number: int, kind: str) -> str:
        split = "train" if number < 3 else "test"
        return f"{kind}/{split}/10:0{number % 3} {SCENES[number][0]}.png"

    manifest = built(rearranged(tmp_path, name))[1].manifest
    assert manifest.scenes[0].name == "10-00-s"
    assert manifest.scenes[0].names == {"split": "test", "file": "10:00 s"}
    assert len(manifest.scenes_of("train")) == 3


def make_idfd(folder: Path) -> Path:
    """Write views in iDFD's layout, three a place but for the last, and return the folder."""
    made = make_folder(folder / "made")
    places = ("Apartment1", "Bedroom_room2", "Bedroom_room3", "Lab 4", "Museum")
    names = [f"{place}_{view}" for place in places for view in range(3)]
    kinds = {"sharp": "All_In_Focus", "blurred": "Out_Of_Focus", "depth": "Depth"}
    for number, name in enumerate(names[:-2]):
        for kind, place in kinds.items():
            ending = ".png" if kind == "depth" else (".JPG", ".jpg")[number % 2]
            path = folder / "iDFD/Data/Processed/inpainting" / place / f"{name}{ending}"
            path.parent.mkdir(parents=True, exist_ok=True)
            source = str(made / SCENES[number % 4] / f"{kind}.png")
            image = np.asarray(cv2.imread(source, cv2.IMREAD_UNCHANGED))
            cv2.imwrite(str(path), image)
    return folder / "iDFD"


def test_idfd_is_built_with_the_scenes_that_are_found(tmp_path: Path) -> None:
    folder = make_idfd(tmp_path)
    manifest = with_found_scenes(find_manifest("idfd"), folder)
    report = build_store(manifest, open_source(manifest, folder), tmp_path / "one.zarr")
    assert (report.problems, report.missing) == ((), ())
    assert report.warnings == ("13 scenes found; idfd has 764",)
    store = Dataset(tmp_path / "one.zarr")
    assert store.manifest.scenes_of("test") == ("Lab-4_0", "Lab-4_1", "Lab-4_2")
    assert len(store.manifest.scenes_of("train")) == 10
    assert np.nanmax(store.captures("test")[0].depth) == pytest.approx(4)
    assert datasheet_of(store.manifest) is not None
    assert store.manifest == manifest
    for path in folder.rglob("Lab 4_1.*"):
        path.unlink()
    fewer = with_found_scenes(find_manifest("idfd"), folder)
    with pytest.raises(StoreError, match=r"holds 1 pair that this build lacks: Lab-4_1/"):
        build_store(fewer, open_source(fewer, folder), tmp_path / "one.zarr")
    # With other bounds it is not idfd, whatever scenes are found.
    text = find_manifest("idfd").toml.replace("far = 10.0", "far = 9.0")
    edited = with_found_scenes(parse_manifest(text.encode(), "idfd-1.toml"), folder)
    with pytest.raises(StoreError, match="built from another manifest than idfd-1"):
        manifest_in({"manifest": edited.toml}, "one.zarr")


def test_a_folder_without_a_scene_to_find_says_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"no file fits files\.infocus.*door/blurred\.png"):
        with_found_scenes(find_manifest("idfd"), make_folder(tmp_path / "other"))


def test_depth_in_one_split_only_is_split_by_number(tmp_path: Path) -> None:
    # As in ZEDD, whose test scenes have no depth.
    made = make_folder(tmp_path / "made")
    for scene in SCENES:
        depth = np.asarray(cv2.imread(str(made / scene / "depth.png"), cv2.IMREAD_UNCHANGED))
        np.save(made / scene / "depth.npy", (depth / 1000).astype(np.float32))
        (made / scene / "depth.png").unlink()
        (tmp_path / "My set/val").mkdir(parents=True, exist_ok=True)
        (made / scene).rename(tmp_path / "My set/val" / scene)
    manifest = built(tmp_path / "My set")[1].manifest
    assert (manifest.stem, manifest.scenes_of("train")) == ("My-set-1", SCENES[:3])
    assert manifest.scenes_of("test") == SCENES[3:]
    assert manifest.scenes[0].names == {"split": "val"}


def test_files_paired_by_order_are_named_and_asked_about(tmp_path: Path) -> None:
    steps = {"sharp": 0, "blurred": 7, "depth": 14}
    folder = rearranged(tmp_path, lambda at, kind: f"{kind}/{1000 * at + steps[kind]}.png")
    written, store = built(folder)
    manifest = store.manifest
    assert (manifest.scenes[1].name, manifest.scenes[1].names["depth"]) == ("scene-2", "1014")
    assert any("by their order" in text for text in written.open)


def test_one_scene_may_lie_in_the_folder_itself(tmp_path: Path) -> None:
    written, store = built(make_folder(tmp_path / "mine") / "desk")
    assert store.manifest.scenes_of("test") == ("desk",)
    assert not any("for testing" in text for text in written.open)
    with pytest.raises(StoreError, match="Fix: a method with a fit needs more scenes"):
        training_scenes(store.manifest, "test")


def test_names_that_differ_in_every_scene_are_told(tmp_path: Path) -> None:
    def name(number: int, kind: str) -> str:
        numbers = {"sharp": 2 * number + 7001, "blurred": 2 * number + 7002}
        return f"{number}/{f'IMG_{numbers[kind]}' if kind in numbers else kind}.png"

    with pytest.raises(InputError, match=r"(?s)no scene has all files.*Fix: name a scene's files"):
        new_manifest(rearranged(tmp_path, name))


def test_damage_and_what_is_lacking_are_told_together(tmp_path: Path) -> None:
    folder = make_folder(tmp_path)
    (folder / SCENES[0] / "sharp.png").write_bytes(b"")
    (folder / SCENES[1] / "depth.png").unlink()
    with pytest.raises(SourceError) as told:
        new_manifest(folder)
    damaged, lacking = told.value.problems
    assert damaged.where == str(folder / SCENES[0] / "sharp.png")
    assert SCENES[1] in lacking.what


def test_a_folder_without_scenes_says_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        new_manifest(tmp_path / "none")
    with pytest.raises(InputError, match="the folder is empty"):
        new_manifest(tmp_path)
    (tmp_path / "one.png").touch()
    (tmp_path / "two.txt").touch()
    with pytest.raises(InputError, match=r"two\.txt is a file, not a folder"):
        new_manifest(tmp_path / "two.txt")
    told = r"no scene with a photograph or two.*: got one\.png; not read: 1 \.txt\nFix: rename"
    with pytest.raises(InputError, match=told):
        new_manifest(tmp_path)


@pytest.mark.parametrize("names", ["{scene}/{kind}", "val/place-{place}/{place}{_kind}"])
def test_a_photograph_and_a_depth_map_are_for_a_recipe(tmp_path: Path, names: str) -> None:
    def name(number: int, kind: str) -> str:
        parts = {"scene": SCENES[number], "place": number, "kind": kind}
        return names.format(**parts, _kind=f"_{kind}" * (kind != "sharp")) + ".png"

    folder = rearranged(tmp_path, name)
    for path in folder.rglob("*blurred.png"):
        path.unlink()
    written, store = built(folder)
    assert any("a recipe blurs it" in text for text in written.found)
    for capture in store.captures():
        levels = np.nan_to_num(capture.depth).astype(np.uint8)
        made = synthesize(capture.infocus, levels, RECIPES["published"])
        np.testing.assert_array_equal(capture.defocus, made)
    assert with_track(store.manifest, "noise-1").on_track
