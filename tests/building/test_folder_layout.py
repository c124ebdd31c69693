import json
import re
import shutil
from itertools import product
from pathlib import Path

import numpy as np

import dfdbench as dfd
from dfdbench.building.export import export_png
from dfdbench.building.folder_layout import find_layout, find_stacks, image_files
from dfdbench.building.new_manifest import new_manifest
from tests.made_folder import SCENES, built, photograph, rearranged
from tests.made_stack_folder import FOCUS, make_stacks, write_image
from tests.made_zedd import MOTORS, make_zedd

NAMES = ("desk_1", "door", "x-2")


def patterns(paths: list[str]) -> list[str]:
    layout = find_layout(tuple(sorted(paths)))
    assert layout is not None
    assert not layout.by_order
    assert [scene for _, scene in layout.scenes] == sorted(NAMES)
    return [group.pattern for group in layout.groups]


def test_scenes_are_told_by_what_their_files_share() -> None:
    for kinds in (
        ["{scene}/blurred.png", "{scene}/depth.tiff", "{scene}/sharp.JPG"],
        ["depth/{scene}.png", "f2/{scene}.jpg", "f8/{scene}.jpg"],
        ["a/{scene}/depth/map.png", "a/{scene}/near.png", "a/{scene}/sharp.png"],
        ["{scene}_blurred.png", "{scene}_depth.png", "{scene}_sharp.png"],
        ["depth_{scene}.png", "f2_{scene}.png", "f8_{scene}.png"],
        # Words may hold a number with a fraction, and one file no word at all.
        ["{scene}_depth.png", "{scene}_f16.jpg", "{scene}_f2.8.jpg"],
        ["{scene}_depth.pfm", "{scene}_f2.8.TIF", "{scene}_f22.TIF"],
        ["depth_{scene}.png", "f1.8_{scene}.jpg", "f16_{scene}.jpg"],
        ["{scene}.JPG", "{scene}_blur.JPG", "{scene}_depth.png"],
        # An image in two formats is two kinds.
        ["depth/{scene}.png", "f2/{scene}.jpg", "f2/{scene}.png", "f8/{scene}.jpg"],
    ):
        paths = [kind.replace("{scene}", scene) for kind in kinds for scene in NAMES]
        assert patterns(paths) == kinds
    # Kinds may differ in nothing but their endings.
    paths = [f"depth/{scene}.png" for scene in NAMES]
    paths += ["f2/desk_1.JPG", "f2/door.jpg", "f2/x-2.jpeg"]
    paths += ["f8/desk_1.png", "f8/door.png", "f8/x-2.JPG"]
    assert patterns(paths) == ["depth/{scene}.png", "f2/{scene}.*", "f8/{scene}.*"]


def test_each_frame_of_a_place_is_a_scene() -> None:
    forms = ("{0}/{2}/{1}", "{0}/{2}_{1}", "{2}/{0}/{1}", "{0}/{1}_{2}", "{0}/{1}/{2}")
    for form, kinds in product(forms, (("depth", "rgb"), ("depth", "sharp", "soft"))):
        frames = product(("desk", "hall"), ("0000", "0001", "0002"), kinds)
        layout = find_layout(tuple(sorted(f"{form}.png".format(*each) for each in frames)))
        assert layout is not None
        assert (len(layout.scenes), len(layout.groups)) == (6, len(kinds))
        for key in layout.scenes:
            names = (re.findall(r"desk|hall|\d+", group.files[key]) for group in layout.groups)
            assert len(set(map(tuple, names))) == 1


def test_only_images_count_and_none_that_is_hidden(tmp_path: Path) -> None:
    others = ("a/notes.txt", ".cache/d.png", "a/._b.png", "a/K.npy")
    for name in ("a/b.PNG", "a/c.tif", "a/gt.npy", *others):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert image_files(tmp_path) == ("a/b.PNG", "a/c.tif", "a/gt.npy")


def test_a_folder_of_stacks_is_told_and_builds_without_scenes_of_one_image(tmp_path: Path) -> None:
    folder = make_stacks(tmp_path / "mine")
    for image in sorted((folder / SCENES[0]).glob("f_*.png"))[1:]:
        image.unlink()
    written, store = built(folder)
    assert any(f"{SCENES[0]}/f_001.png" in text for text in written.open)
    assert store.scenes == tuple(sorted(SCENES[1:]))
    files = store.manifest.files
    assert files is not None
    assert files.patterns == {
        "infocus": "{scene}/sharp.png",
        "images": "{scene}/f_{image}.png",
        "depth": "{scene}/depth.npy",
        "metadata": "{scene}/focus.csv",
    }
    assert "stacks {scene}/f_{image}.png of 3 images" in written.found
    stack = store.captures("test")[0].stack
    assert stack.attrs["unit"] == "metres"
    np.testing.assert_array_equal(stack.focus_distance, [np.nan, *sorted(FOCUS.values())[::-1]])


def test_one_scene_may_lie_in_the_folder_itself_and_hold_disparity(tmp_path: Path) -> None:
    # As the stack of a light field, whose depth is in pixels a view.
    made = make_stacks(tmp_path / "made") / "desk"
    rows = [float(row) for row in (-1.5, 0.25, 2)]
    (made / "focus.csv").unlink()
    (made / "focus.json").write_text(json.dumps({"focus_disparity": rows, "views": 61}))
    disparity = np.repeat(np.linspace(-2, 2.5, 72)[:, None], 96, axis=1).astype(np.float32)
    np.save(made / "disparity.npy", disparity)
    (made / "depth.npy").unlink()
    written, store = built(made)
    assert store.manifest.scene_names == ("desk",)
    assert not any("for testing" in text for text in written.open)
    assert any(text.endswith("equally bright: align, match_gain") for text in written.open)
    assert any("neither metres nor levels: -2 to 2.5" in text for text in written.found)
    capture = store.captures("test")[0]
    assert len(np.unique(capture.truth)) == 72
    # A depth of the file and a focus at it are the same level.
    expected = np.interp(rows, disparity[:, 0], capture.depth[:, 0])
    np.testing.assert_allclose(capture.stack.focus_depth[1:], expected, atol=0.01)


def test_cells_of_a_table_may_tell_images_apart(tmp_path: Path) -> None:
    # As in ZEDD, where run and motor go together, and the table has no heading.
    written, store = built(make_zedd(tmp_path / "mine"))
    assert 'img_{column_1}_motor_{column_2}_aperture_F1.4.jpg"' in written.toml
    assert any("_aperture_F16.0.jpg is in focus all over" in text for text in written.open)
    assert any("F2.8.jpg" in text and "values of an axis" in text for text in written.open)
    assert any(text.endswith("is the focus in metres") for text in written.open)
    stack = store.captures()[0].stack
    np.testing.assert_array_equal(stack.focus_distance[1:], [*MOTORS.values()][::-1])


def test_names_may_tell_the_focus(tmp_path: Path) -> None:
    folder = make_stacks(tmp_path / "mine")
    for path in sorted(folder.rglob("f_*.png")):
        path.rename(path.with_name(f"focus {50 * int(path.stem[-1]):.2f} cm.png"))
    for path in folder.rglob("focus.csv"):
        path.unlink()
    first = folder / SCENES[0]
    shutil.copy(first / "focus 100.00 cm.png", first / "focus 200.00 cm.png")
    written, store = built(folder)
    assert f"scenes without 3 images: {SCENES[0]} (4)" in written.open
    assert "whether image is the focus in cm" in written.open
    stack = store.captures(SCENES[1])[0].stack
    np.testing.assert_array_equal(stack.focus_distance, [np.nan, 1.5, 1, 0.5])


def test_a_stack_without_depth_or_table_asks_for_them(tmp_path: Path) -> None:
    folder = make_stacks(tmp_path / "mine")
    for scene in SCENES:
        for name in ("focus.csv", "depth.npy", "sharp.png"):
            (folder / scene / name).unlink()
    written, store = built(folder)
    assert not store.manifest.has_truth
    asked = [text.partition(":")[0] for text in written.open[:3]]
    assert asked == ["whether an image is in focus all over", "depth", "focus distances"]


def test_photographs_of_several_apertures_are_no_stack(tmp_path: Path) -> None:
    folder = make_stacks(tmp_path / "mine")
    for scene in SCENES:
        for name in ("focus.csv", "sharp.png"):
            (folder / scene / name).unlink()
        for path, stop in zip(sorted((folder / scene).glob("f_*.png")), (2, 4, 16), strict=True):
            path.rename(path.with_name(f"f{stop}.png"))
    toml = new_manifest(folder).toml
    assert 'infocus = "{scene}/f16.png"' in toml
    assert "images" not in toml


def test_what_may_not_be_a_stack_or_is_not_read_is_told(tmp_path: Path) -> None:
    folder = make_stacks(tmp_path / "mine")
    for scene in SCENES:
        table = folder / scene / "focus.csv"
        table.write_text("image;focus\n1;1 m\n2;2 m\n3;4 m\n")
    (asked,) = (text for text in new_manifest(folder).open if text.startswith("which column"))
    assert asked.endswith("; not a number in every row: focus")
    for scene in SCENES:
        table = folder / scene / "focus.csv"
        table.write_text("image;lens_dioptres\n1;1\n2;0,5\n3;0\n")
    _, store = built(folder)
    stack = store.captures()[0].stack
    np.testing.assert_array_equal(stack.focus_distance, [np.nan, np.inf, 2, 1])
    export_png(store, tmp_path / "png", images_only=True)
    said = next((tmp_path / "png").rglob("stack.json")).read_text()
    # Readers in other languages know no constants: here int refuses them.
    focus = json.loads(said, parse_constant=int)["coordinates"]["focus_distance"]
    assert focus == [None, "inf", 2, 1]
    assert np.nanmax(dfd.load_method("shape-from-focus")(stack[1:])) <= 255
    for number, scene in enumerate(SCENES):
        write_image(folder / scene / "f_004.png", photograph(10 + number))
        depth = np.nan_to_num(1000 * np.load(folder / scene / "depth.npy")).astype(np.uint16)
        write_image(folder / scene / "Tiefe.png", depth)
        (folder / scene / "depth.npy").unlink()
    # Grey with 16 bits, it is a depth map whatever its name.
    assert 'depth = "{scene}/Tiefe.png"' in new_manifest(folder).toml
    for scene in SCENES:
        (folder / scene / "Tiefe.png").rename(folder / scene / "depth.exr")
    told = new_manifest(folder).open
    assert f"whether photographs are a stack: they look unlike in {', '.join(SCENES)}" in told
    assert any(text.startswith("depth: none was found; not read: 4 .csv, 4 .exr") for text in told)
    assert any(f"{SCENES[0]}/focus.csv with 3 rows" in text for text in told)


def test_stacks_without_the_depth_that_most_have_are_named_or_counted(tmp_path: Path) -> None:
    folder = make_stacks(tmp_path / "mine")
    first, *others, third = SCENES
    (folder / first / "depth.npy").unlink()
    written, store = built(folder)
    assert store.scenes == tuple(sorted((*others, third)))
    assert f"left out 1 scene without depth: {first}" in written.open
    (folder / third / "focus.csv").write_text("image,focus_distance\n1")
    assert f"no tables with a row per image: {third}/focus.csv" in new_manifest(folder).open
    for scene in others:
        (folder / scene / "depth.npy").unlink()
    rows = ["image,focus_distance"]
    for path in folder.rglob("focus.csv"):
        path.unlink()
    for seed, scene in enumerate(SCENES):
        for number in FOCUS:
            name = f"{seed}{number}.png"
            (folder / scene / f"f_{number:03}.png").rename(folder / scene / name)
            rows.append(f"{name},{number}")
    (folder / "focus.csv").write_text("\n".join(rows))
    assert 'metadata = "focus.csv"' in new_manifest(folder).toml
    (told,) = (text for text in new_manifest(folder).open if text.startswith("depth"))
    assert told == "depth: in 1 of 4 scenes, so that nothing can be scored"


def test_where_depth_maps_are_numbered_the_numbers_are_scenes(tmp_path: Path) -> None:
    folder = rearranged(tmp_path, lambda number, kind: f"{kind}/{number}.png")
    paths = tuple(str(path.relative_to(folder)) for path in folder.rglob("*.png"))
    assert find_stacks(folder, paths) is None
    # Apertures are no distances.
    assert find_stacks(folder, ("a/f_1.4.png", "a/f_2.8.png", "a/f_5.6.png", "a/depth.npy")) is None
    found = find_stacks(folder, ("f_1.4_fd_0.5.png", "f_1.4_fd_1.0.png", "f_1.4_fd_2.0.png"))
    assert list(found.images if found else ()) == ["f_1.4_fd_{image}.png"]
    found = find_stacks(folder, tuple(f"s/im_{number}.png" for number in ("0.80", "1.80", "1.93")))
    assert list(found.images if found else ()) == ["s/im_{image}.png"]
    assert "defocus" in new_manifest(folder).toml
