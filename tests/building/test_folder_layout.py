from pathlib import Path

import pytest

from dfdbench.building.folder_layout import find_layout, image_files

SCENES = ("desk_1", "door", "x-2")


def patterns(paths: list[str]) -> list[str]:
    layout = find_layout(tuple(sorted(paths)))
    assert layout is not None
    assert not layout.by_order
    assert [scene for _, scene in layout.scenes] == sorted(SCENES)
    return [group.pattern for group in layout.groups]


@pytest.mark.parametrize(
    "kinds",
    [
        ["{scene}/blurred.png", "{scene}/depth.tiff", "{scene}/sharp.JPG"],
        ["depth/{scene}.png", "f2/{scene}.jpg", "f8/{scene}.jpg"],
        ["a/{scene}/depth/map.png", "a/{scene}/near.png", "a/{scene}/sharp.png"],
        ["{scene}_blurred.png", "{scene}_depth.png", "{scene}_sharp.png"],
        ["depth_{scene}.png", "f2_{scene}.png", "f8_{scene}.png"],
        # An image in two formats is two kinds.
        ["depth/{scene}.png", "f2/{scene}.jpg", "f2/{scene}.png", "f8/{scene}.jpg"],
    ],
)
def test_scenes_are_told_by_what_their_files_share(kinds: list[str]) -> None:
    assert patterns([kind.replace("{scene}", scene) for kind in kinds for scene in SCENES]) == kinds


def test_kinds_may_differ_in_nothing_but_their_endings() -> None:
    paths = [f"depth/{scene}.png" for scene in SCENES]
    paths += ["f2/desk_1.JPG", "f2/door.jpg", "f2/x-2.jpeg"]
    paths += ["f8/desk_1.png", "f8/door.png", "f8/x-2.JPG"]
    assert patterns(paths) == ["depth/{scene}.png", "f2/{scene}.*", "f8/{scene}.*"]


def test_splits_are_told_from_scenes() -> None:
    kinds = ("depth/{split}/{scene}.png", "f2/{split}/{scene}.png", "f8/{split}/{scene}.png")
    paths = [
        kind.replace("{split}", split).replace("{scene}", str(number))
        for kind in kinds
        for split in ("train", "test")
        for number in (1, 2)
    ]
    layout = find_layout(tuple(sorted(paths)))
    assert layout is not None
    assert [group.pattern for group in layout.groups] == list(kinds)
    assert layout.scenes == (("test", "1"), ("test", "2"), ("train", "1"), ("train", "2"))
    assert layout.groups[1].files["train", "2"] == "f2/train/2.png"


def test_only_images_count_and_none_that_is_hidden(tmp_path: Path) -> None:
    others = ("a/notes.txt", ".cache/d.png", "a/._b.png", "a/K.npy")
    for name in ("a/b.PNG", "a/c.tif", "a/gt.npy", *others):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert image_files(tmp_path) == ("a/b.PNG", "a/c.tif", "a/gt.npy")
