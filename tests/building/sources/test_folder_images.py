from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.building.build import build_store
from dfdbench.building.sources import open_source
from dfdbench.building.sources.folder import read_table
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import SourceError
from tests.conftest import store_of
from tests.made_folder import depth_in_millimetres, photograph
from tests.made_stack_folder import STACK_TOML, make_stacks, write_image

WITHOUT_TABLE = ('metadata = "{scene}/focus.csv"\n', "")
WITHOUT_INFOCUS = ('infocus = "{scene}/sharp.png"\n', "")


def manifest_of(*changes: tuple[str, str]) -> Manifest:
    text = STACK_TOML
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return parse_manifest(text.encode(), "mine-1.toml")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_stacks(tmp_path / "captures")


def problems_of(manifest: Manifest, folder: Path, scene: str = "desk") -> str:
    with pytest.raises(SourceError) as caught:
        open_source(manifest, folder).signature(scene)
    return str(caught.value)


def table(folder: Path, *rows: str, scene: str = "desk") -> None:
    (folder / scene / "focus.csv").write_text("\n".join(("image,focus_distance", *rows)))


def test_a_stack_is_in_focus_first_and_then_the_farthest_first(folder: Path) -> None:
    images = open_source(manifest_of(), folder).read("desk")
    assert images.images.shape[:2] == (1, 4)
    assert images.facts.roles == ("infocus", "defocus", "defocus", "defocus")
    np.testing.assert_array_equal(images.facts.focus_distance[0], [np.nan, 4, 2, 1])
    np.testing.assert_array_equal(images.images[0, 3, ..., ::-1], _read(folder / "desk/f_001.png"))


def test_a_stack_without_a_table_is_in_order_of_its_numbers(folder: Path) -> None:
    images = open_source(manifest_of(WITHOUT_TABLE), folder).read("desk")
    np.testing.assert_array_equal(images.images[0, 1, ..., ::-1], _read(folder / "desk/f_001.png"))
    assert np.isnan(images.facts.focus_distance).all()


def test_a_table_goes_with_images_by_number_or_by_order(folder: Path) -> None:
    known = open_source(manifest_of(), folder).read("desk")
    table(folder, "3,4", "1,1", "2,2")
    again = open_source(manifest_of(), folder).read("desk")
    np.testing.assert_array_equal(known.images, again.images)
    (folder / "desk/focus.csv").write_text("focus_distance\n1\n2\n4\n")
    again = open_source(manifest_of(), folder).read("desk")
    np.testing.assert_array_equal(known.images, again.images)


def test_the_manifest_may_hold_the_table_and_facts_may_be_stated(folder: Path) -> None:
    rows = "\n".join(
        f'[[files.image]]\nnumber = "{number:03}"\nmetres = {metres}'
        for number, metres in ((1, 1.0), (2, 2), (3, 4))
    )
    manifest = manifest_of(
        ('metadata = "{scene}/focus.csv"', 'focus_distance = "{metres}"\nf_number = 2.8'),
        ("f_{image}.png", "f_{number}.*"),
        ("[table]", f"{rows}\n\n[table]"),
    )
    facts = open_source(manifest, folder).read("desk").facts
    np.testing.assert_array_equal(facts.focus_distance[0], [np.nan, 4, 2, 1])
    np.testing.assert_array_equal(facts.f_number[0], [np.nan, 2.8, 2.8, 2.8])


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["1,1", "2,2"], "images that the table does not tell of: desk/f_003.png (WHERE)"),
        (["1,1", "2,2", "3,4", "4,8"], "a file is missing (FOLDER/desk/f_4.png)"),
        (["1,1", "2,2", "3,2"], "two images are focused at 2 (WHERE)"),
        (["1,1", "2,2", "3,far"], "focus_distance is 'far', and not a number above 0"),
        (["1,1", "2,2", "3,-4"], "focus_distance is '-4', and not a number above 0"),
        (["1,1", "2,2", "3,0.04"], "focus_distance 0.04 m is not beyond the focal length, 0.05 m"),
        (["1,1", "2,2", "3"], "no table of the images: 3, where image, focus_distance"),
        (["one,1", "2,2", "3,4"], "invalid literal"),
        ([], "the table of the images is empty (WHERE)"),
    ],
)
def test_a_table_that_fits_no_images_is_told(folder: Path, rows: list[str], said: str) -> None:
    table(folder, *rows)
    text = problems_of(manifest_of(), folder)
    place = said.replace("WHERE", str(folder / "desk/focus.csv")).replace("FOLDER", str(folder))
    assert place in text


def test_one_image_is_no_stack_and_none_is_told(folder: Path) -> None:
    manifest = manifest_of(WITHOUT_INFOCUS)
    for number in (2, 3):
        (folder / f"desk/f_{number:03}.png").unlink()
    table(folder, "1,1")
    assert "a stack of one image" in problems_of(manifest, folder)
    (folder / "desk/f_001.png").unlink()
    manifest = manifest_of(WITHOUT_TABLE, WITHOUT_INFOCUS)
    assert "no image fits the pattern" in problems_of(manifest, folder)


def test_a_column_that_is_not_there_and_a_pair_beyond_the_end(folder: Path) -> None:
    manifest = manifest_of(("[files]", '[files]\nf_number = "{aperture}"'))
    assert "the table has no column aperture" in problems_of(manifest, folder)
    manifest = manifest_of(("[axes]", "pair_images = [0, 4]\n\n[axes]"))
    assert "pair_images are [0, 4], and there are 4 images" in problems_of(manifest, folder)


def test_what_is_wrong_with_scenes_is_told_and_others_built(folder: Path, tmp_path: Path) -> None:
    table(folder, "1,1", "2,1", "3,4", scene="desk")
    write_image(folder / "door/f_002.png", photograph(9, (40, 50)))
    np.save(folder / "lamp/depth.npy", np.full(depth_in_millimetres().shape, np.nan))
    manifest = manifest_of()
    report = build_store(manifest, open_source(manifest, folder), tmp_path / "mine.zarr")
    assert report.scenes_built == ("shelf",)
    assert [(problem.what, Path(problem.where).name) for problem in report.problems] == [
        ("two images are focused at 1", "focus.csv"),
        ("size differs", "f_002.png"),
        ("none of 6912 depths is finite and above 0, and not missing", "depth.npy"),
    ]
    capture = Dataset(tmp_path / "mine.zarr").captures()[0]
    assert capture.stack.attrs["unit"] == "metres"
    assert np.nanmax(capture.depth) == pytest.approx(4.0)


def test_images_of_16_bits_are_kept_and_those_of_8_join_them(folder: Path) -> None:
    deep = np.linspace(0, 65535, 72 * 96).reshape(72, 96).astype(np.uint16)
    write_image(folder / "desk/f_002.png", deep)
    images = open_source(manifest_of(), folder).read("desk").images
    assert images.dtype == np.uint16
    np.testing.assert_array_equal(images[0, 2, ..., 0], deep)
    eight = _read(folder / "desk/sharp.png")[..., ::-1].astype(np.uint16)
    np.testing.assert_array_equal(images[0, 0], eight * 257)


def test_captures_of_a_scene_have_images_alike(folder: Path) -> None:
    twice = (("capture = [1]", "capture = [1, 2]"), ("pairs = 2", "pairs = 4"))
    named = ("f_{image}", "{capture}_{image}")
    manifest = manifest_of(*twice, ("pair_count = 4", "pair_count = 8"), named, WITHOUT_TABLE)
    for capture in (1, 2):
        for number in (1, 2, 3):
            image = photograph(number)[8:-8, 8:-8]
            deep = image.astype(np.uint16) * 257 if capture == 2 else image
            write_image(folder / f"desk/{capture}_{number}.png", deep)
    with pytest.raises(SourceError, match="differ in the number, size, bits or roles"):
        open_source(manifest, folder).read("desk")


def test_each_image_of_a_stack_is_laid_on_the_first_one(folder: Path) -> None:
    sharp = photograph(0)
    write_image(folder / "desk/f_002.png", (0.9 * sharp[7:-9, 6:-10]).astype(np.uint8)[..., ::-1])
    manifest = manifest_of(("[files]", '[files]\nalign = "translation"\nmatch_gain = true'))
    images = open_source(manifest, folder).read("desk")
    # The farthest is first: f_002 is the second of the three.
    found = images.found["desk/capture1/image2"]
    assert (found["right"], found["down"]) == (-2, -1)
    assert found["gain"] == pytest.approx(1 / 0.9, abs=0.02)
    assert abs(images.images[0, 2] - sharp[8:-8, 8:-8].astype(float)).mean() < 3
    assert np.isnan(images.depth[-1, :]).all()


def test_a_set_without_depth_is_built_and_says_so(folder: Path, tmp_path: Path) -> None:
    manifest = manifest_of(('depth = "{scene}/depth.npy"\n', ""))
    store = store_of(manifest, folder, tmp_path / "mine.zarr")
    assert not store.manifest.has_truth
    assert not store.captures()[0].valid.any()


def test_json_holds_records_or_lists() -> None:
    records = b'[{"image": 3, "focus_distance": 0.5}]'
    assert read_table(records, "a.json", []) == [{"image": "3", "focus_distance": "0.5"}]
    for wrong in (b"3", b"[3]", b"{", b"\xff"):
        with pytest.raises(SourceError, match="no table of the images"):
            read_table(wrong, "a.json", [])


def _read(path: Path) -> NDArray[Any]:
    return np.asarray(cv2.imread(str(path)))


def test_a_mistake_in_a_table_of_all_scenes_is_told_once(folder: Path, tmp_path: Path) -> None:
    (folder / "focus.csv").write_text("image,focus_distance\n1,1\n2,far\n3,4\n")
    manifest = manifest_of(('"{scene}/focus.csv"', '"focus.csv"'))
    with pytest.raises(SourceError) as caught:
        build_store(manifest, open_source(manifest, folder), tmp_path / "mine.zarr")
    assert len(caught.value.problems) == 1
    assert str(caught.value).endswith("focus.csv): got desk/f_002.png and 3 more")
