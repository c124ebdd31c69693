"""Captured sets that their manifest describes: whole, in part, and not at all."""

import hashlib
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

import dfdbench as dfd
from dfdbench.blur.formation import form_stack
from dfdbench.blur.light import decode
from dfdbench.blur.recipe import RECIPES
from dfdbench.board.row_file import known_fingerprints
from dfdbench.building.build import build_store
from dfdbench.building.sources import SceneError, open_source
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import SourceError
from dfdbench.system.parallel import Threads
from tests.conftest import read_rgb
from tests.made_folder import FOLDER_TOML, SCENES, depth_in_millimetres, make_folder, photograph
from tests.made_stack_folder import FOCUS, STACK_TOML, make_stacks, write_image


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


def test_a_pair_may_keep_the_numbers_of_its_camera(folder: Path) -> None:
    matched = FOLDER_TOML.replace("[table]", 'align = "translation"\nmatch_gain = true\n\n[table]')
    named = open_source(manifest_of(matched), folder).read("lamp")
    for number, scene in enumerate(SCENES):
        for place, name in enumerate(("sharp.png", "blurred.png")):
            (folder / scene / name).rename(folder / scene / f"IMG_{2 * number + place + 997}.png")
    roles = "".join(f'[[files.image]]\nrole = "{role}"\n' for role in ("infocus", "defocus"))
    text = matched.replace(
        'infocus = "{scene}/sharp.png"\ndefocus = "{scene}/blurred.png"',
        'images = "{scene}/IMG_{image}.png"',
    )
    text = text.replace("[table]", f"{roles}\n[table]")
    numbered = open_source(manifest_of(text), folder).read("lamp")
    assert np.array_equal(numbered.images, named.images)
    assert not numbered.warnings
    flat = text.replace(
        "[[files.image]]", "flat_field = [[1, 1], [1, 1], [1, 1]]\n[[files.image]]", 1
    )
    assert np.array_equal(open_source(manifest_of(flat), folder).read("lamp").images, named.images)
    # The counter of a camera begins again after 9999: the blurred one comes first.
    turned = text.replace('"infocus"', '"x"').replace('"defocus"', '"infocus"')
    swapped = open_source(manifest_of(turned.replace('"x"', '"defocus"')), folder).read("lamp")
    assert "are the two swapped?" in str(swapped.warnings)


def test_a_flat_field_gives_the_defocus_image_back_its_corners(folder: Path) -> None:
    halved = "[[1.0, 0.5], [1.0, 0.5], [1.0, 1.0]]"
    plain = open_source(manifest_of(), folder).read("desk")
    text = FOLDER_TOML.replace("[table]", f"flat_field = {halved}\n\n[table]")
    even = open_source(manifest_of(text), folder).read("desk")
    assert np.array_equal(even.infocus, plain.infocus)
    before, after = (decode(images.defocus[0, 0, 0].astype(float)) for images in (plain, even))
    seen = before < 0.45
    assert after[seen] == pytest.approx((np.array([2, 2, 1]) * before)[seen], rel=0.03)


def test_patterns_that_match_nothing_say_what_is_there(folder: Path) -> None:
    text = FOLDER_TOML.replace("{scene}/sharp.png", "{scene}/infocus.png")
    told = r"no file matches files.infocus, .*, as desk/infocus.png"
    with pytest.raises(SourceError, match=told) as caught:
        open_source(manifest_of(text), folder)
    (problem,) = caught.value.problems
    assert "desk/blurred.png" in problem.got
    with pytest.raises(SourceError, match="no such folder"):
        open_source(manifest_of(), folder / "nowhere")


@pytest.mark.parametrize("outside", ["../{0}/desk/sharp", "{1}/desk/sharp"])
@pytest.mark.parametrize("infocus", ["{x}.png", "{x}.*", "{capture}.png"])
def test_no_name_leads_out_of_the_folder(folder: Path, infocus: str, outside: str) -> None:
    outside = outside.format(folder.name, folder)
    text = FOLDER_TOML.replace("{scene}/sharp.png", infocus)
    text = text.replace("[table]", f'axis_names = {{ capture = {{ 1 = "{outside}" }} }}\n\n[table]')
    text = text.replace('source = "me"', f'source = "me"\nnames = {{ x = "{outside}" }}')
    with pytest.raises(SourceError, match="the path leads outside the folder: "):
        open_source(manifest_of(text), folder).read("desk")


def test_no_table_leads_out_of_the_folder(tmp_path: Path) -> None:
    folder = make_stacks(tmp_path / "stacks")
    write_image(tmp_path / "private.png", photograph(9))
    with (folder / "desk/focus.csv").open("a") as table:
        table.write("\n../../private.png,8")
    with pytest.raises(SourceError, match="the path leads outside the folder: "):
        open_source(manifest_of(STACK_TOML), folder).read("desk")


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


@pytest.mark.slow
def test_the_fingerprint_of_dfd_indoor(shared_data: Path, tmp_path: Path) -> None:
    manifest, folder = find_manifest("dfd-indoor"), shared_data / "dfd_indoor"
    if not folder.is_dir():
        pytest.skip("no copy of DFD indoor beside the shared Middlebury images")
    source = open_source(manifest, folder, manifest.checksums)
    report = build_store(manifest, source, tmp_path / "dfd.zarr", pool=Threads(2))
    board = Path(__file__).parents[3] / "leaderboard"
    assert report.fingerprint in known_fingerprints(board)["dfd-indoor-1"]
    assert (report.pairs, report.problems, report.warnings) == (110, (), ())


WITHOUT_TABLE = ('metadata = "{scene}/focus.csv"\n', "")
WITHOUT_INFOCUS = ('infocus = "{scene}/sharp.png"\n', "")


def stack_manifest(*changes: tuple[str, str]) -> Manifest:
    text = STACK_TOML
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return parse_manifest(text.encode(), "mine-1.toml")


@pytest.fixture
def stacks(tmp_path: Path) -> Path:
    return make_stacks(tmp_path / "captures")


def problems_of(manifest: Manifest, stacks: Path) -> str:
    with pytest.raises(SourceError) as caught:
        open_source(manifest, stacks).signature("desk")
    return str(caught.value)


def table(stacks: Path, *rows: str) -> None:
    (stacks / "desk/focus.csv").write_text("\n".join(("image,focus_distance", *rows)))


def test_a_stack_is_in_focus_first_then_from_far_to_near_or_else_by_number(stacks: Path) -> None:
    # A table in another order, by the files' names.
    rows = [f"f_{number:03}.png,{FOCUS[number]}" for number in reversed(FOCUS)]
    (stacks / "desk/focus.csv").write_text("\n".join(("name,focus_distance", *rows)))
    images = open_source(stack_manifest(), stacks).read("desk")
    assert images.images.shape[:2] == (1, 4)
    assert images.facts.roles == ("infocus", "defocus", "defocus", "defocus")
    np.testing.assert_array_equal(images.facts.focus_distance[0], [np.nan, 4, 2, 1])
    first = read_rgb(stacks / "desk/f_001.png")
    np.testing.assert_array_equal(images.images[0, 3], first)
    images = open_source(stack_manifest(WITHOUT_TABLE), stacks).read("desk")
    np.testing.assert_array_equal(images.images[0, 1], first)
    assert np.isnan(images.facts.focus_distance).all()


def test_a_table_goes_with_images_by_number_name_or_order(stacks: Path) -> None:
    known = open_source(stack_manifest(), stacks).read("desk")
    for rows in (("3,4", "1,1", "2,2"), ("f_003.png,4", "f_001.png,1", "f_002.png,2")):
        table(stacks, *rows)
        again = open_source(stack_manifest(), stacks).read("desk")
        np.testing.assert_array_equal(known.images, again.images)
    (stacks / "desk/focus.csv").write_text("focus_distance\n1\n2\n4\n")
    again = open_source(stack_manifest(), stacks).read("desk")
    np.testing.assert_array_equal(known.images, again.images)
    # A table of all scenes, by the names of their files.
    others = [f"other_{number}.png,9\nf_{number:03}.png,{FOCUS[number]}" for number in FOCUS]
    for heading in ("image", "file"):
        whole = "\n".join((f"{heading},focus_distance", *others))
        (stacks / "focus.csv").write_text(whole)
        manifest = stack_manifest(("{scene}/focus.csv", "focus.csv"))
        again = open_source(manifest, stacks).read("desk")
        np.testing.assert_array_equal(known.images, again.images)


def test_the_manifest_may_hold_the_table_and_facts_may_be_stated(stacks: Path) -> None:
    rows = "\n".join(
        f'[[files.image]]\nnumber = "{number:03}"\nmetres = {metres}'
        for number, metres in ((1, 1.0), (2, 2), (3, 4))
    )
    manifest = stack_manifest(
        ('metadata = "{scene}/focus.csv"', 'focus_distance = "{metres}"\nf_number = 2.8'),
        ("f_{image}.png", "f_{number}.*"),
        ("[table]", f"{rows}\n\n[table]"),
    )
    facts = open_source(manifest, stacks).read("desk").facts
    np.testing.assert_array_equal(facts.focus_distance[0], [np.nan, 4, 2, 1])
    np.testing.assert_array_equal(facts.f_number[0], [np.nan, 2.8, 2.8, 2.8])


def test_a_table_that_fits_no_images_is_told(stacks: Path) -> None:
    places = {"WHERE": str(stacks / "desk/focus.csv"), "FOLDER": str(stacks)}
    for rows, said in (
        (["1,1", "2,2"], "images that the table does not tell of: desk/f_003.png (WHERE)"),
        (["1,1", "2,2", "3,4", "4,8"], "a file is missing (FOLDER/desk/f_004.png)"),
        (["1,1", "2,2", "3,2"], "two images are focused at 2 (WHERE)"),
        (["1,1", "2,2", "3,far"], "focus_distance is 'far', and not a number above 0"),
        (["1,1", "2,2", "3,0.04"], "focus_distance 0.04 m is not beyond the focal length, 0.05 m"),
        (["1,1", "2,2", "2,3", "3,4"], "the table tells of desk/f_002.png twice (WHERE)"),
        (["1,900", "2,1800", "3,3500"], "focused at 900 to 3500 m, where depths are"),
        (["1,1", "2,2", "3"], "no table of the images: 3, where image, focus_distance"),
        ([], "the table of the images is empty (WHERE)"),
    ):
        table(stacks, *rows)
        told = re.sub("WHERE|FOLDER", lambda word: places[word[0]], said)
        assert told in problems_of(stack_manifest(), stacks)


def test_folders_may_tell_the_focus_which_may_lie_beyond_all_depths(
    stacks: Path, tmp_path: Path
) -> None:
    for scene in SCENES:
        for name, mm in (("f_001", "750.5"), ("f_002", "2000"), ("f_003", "4000"), ("f_001", "90")):
            (stacks / mm).mkdir(exist_ok=True)
            shutil.copy(stacks / scene / f"{name}.png", stacks / mm / f"{scene}.png")
    focus = (
        'metadata = "{scene}/focus.csv"',
        'focus_distance = "{image}"\nfocus_unit = 0.001\ndepth_unit = 1',
    )
    path = ("{scene}/f_{image}.png", "{image}/{scene}.png")
    manifest = stack_manifest(WITHOUT_INFOCUS, focus, path, ('unit = "metres"', 'unit = "levels"'))
    build_store(manifest, open_source(manifest, stacks), tmp_path / "mine.zarr")
    store = Dataset(tmp_path / "mine.zarr")
    facts = store.captures()[0].facts
    np.testing.assert_array_equal(facts.focus_distance, [4, 2, 0.7505, 0.09])
    scale = manifest.depth.scale
    assert scale is not None
    place = np.interp(1 / facts.focus_distance, (1 / scale.far, 1 / scale.near), (1, 255))
    within = (facts.focus_distance > scale.near) & (facts.focus_distance < scale.far)
    np.testing.assert_allclose(facts.focus_depth[within], place[within])
    assert facts.focus_depth[-1] > 300
    # Without two images for a pair, a constant is scored all the same.
    assert "constant" in dfd.run("shape-from-focus", store, "all").verdict()


def test_one_image_is_no_stack_and_none_is_told(stacks: Path) -> None:
    manifest = stack_manifest(WITHOUT_INFOCUS)
    for number in (2, 3):
        (stacks / f"desk/f_{number:03}.png").unlink()
    table(stacks, "1,1")
    assert "a stack of one image" in problems_of(manifest, stacks)
    (stacks / "desk/f_001.png").unlink()
    manifest = stack_manifest(WITHOUT_TABLE, WITHOUT_INFOCUS)
    assert "no image fits the pattern" in problems_of(manifest, stacks)
    # Images whose rows were refused are not lacking.
    table(stacks, "1,far")
    assert "fits the pattern" not in problems_of(stack_manifest(WITHOUT_INFOCUS), stacks)


def test_a_column_that_is_not_there_and_a_pair_beyond_the_end(stacks: Path) -> None:
    manifest = stack_manifest(("[files]", '[files]\nf_number = "{aperture}"'))
    assert "the table has no column aperture" in problems_of(manifest, stacks)
    manifest = stack_manifest(("[axes]", "pair_images = [0, 4]\n\n[axes]"))
    assert "pair_images are [0, 4], and there are 4 images" in problems_of(manifest, stacks)


def test_what_is_wrong_with_scenes_is_told_and_others_built(stacks: Path, tmp_path: Path) -> None:
    table(stacks, "1,1", "2,1", "3,4")
    write_image(stacks / "door/f_002.png", photograph(9, (40, 50)))
    np.save(stacks / "lamp/depth.npy", np.full(depth_in_millimetres().shape, np.nan))
    manifest = stack_manifest()
    report = build_store(manifest, open_source(manifest, stacks), tmp_path / "mine.zarr")
    assert report.scenes_built == ("shelf",)
    assert [(problem.what, Path(problem.where).name) for problem in report.problems] == [
        ("two images are focused at 1", "focus.csv"),
        ("size differs", "f_002.png"),
        ("none of 6912 depths is finite and above 0, and not missing", "depth.npy"),
    ]
    store = Dataset(tmp_path / "mine.zarr")
    assert repr(store) == "<mine-1: 1 pairs of 1 scenes>"
    capture = store.captures()[0]
    assert capture.stack.attrs["unit"] == "metres"
    assert np.nanmax(capture.depth) == pytest.approx(4.0)


def test_images_of_16_bits_are_kept_and_those_of_8_join_them(stacks: Path) -> None:
    deep = np.linspace(0, 65535, 72 * 96).reshape(72, 96).astype(np.uint16)
    write_image(stacks / "desk/f_002.png", deep)
    images = open_source(stack_manifest(), stacks).read("desk").images
    assert images.dtype == np.uint16
    np.testing.assert_array_equal(images[0, 2, ..., 0], deep)
    eight = read_rgb(stacks / "desk/sharp.png").astype(np.uint16)
    np.testing.assert_array_equal(images[0, 0], eight * 257)


def test_the_order_of_a_stack_is_judged_by_what_greater_levels_mean(stacks: Path) -> None:
    grown = (
        ('unit = "metres"', 'unit = "levels"'),
        ('grows_with = "nearness"', 'grows_with = "distance"'),
        ("[depth.scale]", "[depth.scale]\nnear_level = 1\nfar_level = 255"),
        ("[files]", "[files]\ndepth_unit = 1"),
        WITHOUT_INFOCUS,
    )
    scale = stack_manifest().depth.scale
    assert scale is not None
    levels = np.tile(np.linspace(2, 254, 96).astype(np.uint8), (72, 1))
    np.save(stacks / "desk/depth.npy", scale.to_metres(levels).astype(np.float32))
    sharp = photograph(0)[8:-8, 8:-8]
    for number, image in enumerate(form_stack(sharp, levels, RECIPES["published"], 3), 1):
        write_image(stacks / f"desk/f_{number:03}.png", image[..., ::-1])
    for rows, warnings in ((("1,5", "2,0.9", "3,0.5"), 0), (("1,0.5", "2,0.9", "3,5"), 1)):
        table(stacks, *rows)
        for manifest in (stack_manifest(WITHOUT_INFOCUS), stack_manifest(*grown)):
            assert len(open_source(manifest, stacks).read("desk").warnings) == warnings


def test_captures_of_a_scene_have_images_alike(stacks: Path) -> None:
    twice = (("capture = [1]", "capture = [1, 2]"), ("pairs = 2", "pairs = 4"))
    named = ("f_{image}", "{capture}_{image}")
    manifest = stack_manifest(*twice, ("pair_count = 4", "pair_count = 8"), named, WITHOUT_TABLE)
    for capture in (1, 2):
        for number in (1, 2, 3):
            image = photograph(number)[8:-8, 8:-8]
            deep = image.astype(np.uint16) * 257 if capture == 2 else image
            write_image(stacks / f"desk/{capture}_{number}.png", deep)
    with pytest.raises(SourceError, match="differ in the number, size, bits or roles"):
        open_source(manifest, stacks).read("desk")


def test_each_image_of_a_stack_is_laid_on_the_first_one(stacks: Path) -> None:
    sharp = photograph(0)
    write_image(stacks / "desk/f_002.png", (0.9 * sharp[7:-9, 6:-10]).astype(np.uint8)[..., ::-1])
    manifest = stack_manifest(("[files]", '[files]\nalign = "translation"\nmatch_gain = true'))
    images = open_source(manifest, stacks).read("desk")
    # The farthest is first: f_002 is the second of the three.
    found = images.found["desk/capture1/image2"]
    assert (found["right"], found["down"]) == (-2, -1)
    assert found["gain"] == pytest.approx(1 / 0.9, abs=0.02)
    assert abs(images.images[0, 2] - sharp[8:-8, 8:-8].astype(float)).mean() < 3
    assert np.isnan(images.depth[-1, :]).all()


def test_a_mistake_in_a_table_of_all_scenes_is_told_once(stacks: Path, tmp_path: Path) -> None:
    (stacks / "focus.csv").write_text("image,focus_distance\n1,1\n2,far\n3,4\n")
    manifest = stack_manifest(('"{scene}/focus.csv"', '"focus.csv"'))
    with pytest.raises(SourceError) as caught:
        build_store(manifest, open_source(manifest, stacks), tmp_path / "mine.zarr")
    assert len(caught.value.problems) == 1
    assert str(caught.value).endswith("focus.csv): got row of desk/f_002.png and 3 more")
