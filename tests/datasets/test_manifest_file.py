import pytest

from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import ManifestError
from tests.conftest import TINY_TOML
from tests.made_folder import FOLDER_TOML
from tests.made_stack_folder import STACK_TOML

EXCLUSION = """[[exclusions]]
scenes = ["Three"]
coordinates = { view = [5], exposure = [1] }
pairs = 1
reason = "for the test"
"""
METRES = '[depth.scale]\nlaw = "inverse"\nnear = 0.5\nfar = 5.0\n\n[table]'
SCALED = TINY_TOML.replace("[table]", METRES)
LINE = 'infocus = "{scene}/sharp.png"'
IMAGES = 'images = "{scene}/f_{image}.png"'
SCALE = "[depth.scale]\nnear = 0.5\nfar = 5.0\n"


FILES = slice(FOLDER_TOML.index("[files]"), FOLDER_TOML.index("[table]"))


def flat_field(row: str, count: int) -> str:
    return f"flat_field = [{', '.join([row] * count)}]\n\n[table]"


def problems_of(text: str) -> str:
    with pytest.raises(ManifestError) as caught:
        parse_manifest(text.encode(), "mine-1.toml")
    return str(caught.value)


DESK = 'name = "desk"\n'
NAMED = f'{DESK}names = {{ capture = "a" }}\n'
BROKEN: list[tuple[str, str, str, list[str]]] = [
    (TINY_TOML, "pairs = 7", "pairs = 6", ["7 pairs, not 6", "splits[1].pairs"]),
    (TINY_TOML, 'scenes = ["One"]', 'scenes = ["Two"]', ["Two is in two splits"]),
    (TINY_TOML, "exposure = [1] }", "exposure = [2] }", ["exposure2 does not exist"]),
    (TINY_TOML, "pair_count = 11", "pair_count = 12", ["pair_count", "11 pairs", "not 12"]),
    (TINY_TOML, "scene_count = 3", "scene_count = 4", ["scene_count", "3 scenes", "not 4"]),
    (TINY_TOML, 'test_scenes = ["Three"]', 'test_scenes = ["One"]', ["One is not", "in 2"]),
    (TINY_TOML, 'title = "Tiny set"', 'titel = "Tiny set"', ["titel", "unknown field"]),
    (TINY_TOML, 'blocks = "exposure"', 'blocks = "exposition"', ["blocks", "mean exposure"]),
    (TINY_TOML, "schema_version = 1", "schema_version = 2", ["schema_version"]),
    (TINY_TOML, 'name = "Two"\nsource', 'name = "One"\nsource', ["One is listed twice"]),
    (TINY_TOML, '"Two"\nsource = "here"', '"Two"\nsource = "hare"', ["scenes[1].source"]),
    (TINY_TOML, 'name = "Two"', 'name = "zarr.json"', ["named as a file of the store"]),
    (TINY_TOML, "view = [1, 5]", "view = [1, 1]", ["listed twice: [1, 1]", "axes.view"]),
    (TINY_TOML, "[axes]", '[axes]\n"f_number" = [1]', ["'f_number' is no name for an axis"]),
    (TINY_TOML, 'axes = ["view"]', 'axes = ["veiw"]', ["depth.axes", "did you mean view"]),
    (TINY_TOML, EXCLUSION, EXCLUSION * 2, ["excluded twice: Three/view5", "exclusions[1]"]),
    (TINY_TOML, "{ view = [5], ", "{ veiw = [5], ", ["exclusions[0].coordinates", "view"]),
    (TINY_TOML, 'name = "test"', 'name = "train"', ["name is taken", "splits[1].name"]),
    (TINY_TOML, 'name = "test"', 'name = "all"', ["split name is taken: all"]),
    (TINY_TOML, 'scenes = ["One"]', 'scenes = ["One", "One"]', ["twice", "splits[0].scenes"]),
    (TINY_TOML, 'scenes = ["One"]', 'scenes = ["Onu"]', ["splits[0].scenes", "mean One"]),
    (TINY_TOML, 'name = "K2"', 'name = "One"', ["name is taken: One", "folds[1].name"]),
    (TINY_TOML, "[axes]", f'[checksums]\n"Onne/a" = "{"0" * 64}"\n\n[axes]', ["mean One"]),
    (SCALED, "far = 5.0", "far = 0.5", ["near is not before far", "near 0.5, far 0.5"]),
    (SCALED, "far = 5.0", "far = 5.0\nnear_level = 0\nfar_level = 254", ["another way"]),
    (SCALED, "far = 5.0", "far = 5.0\nfar_level = 0", ["0, stands for a distance as well"]),
    (SCALED, "[table]", "[rig]\nnear = 3.0\nfar = 2.0\n\n[table]", ["rig", "near 3, far 2"]),
    (FOLDER_TOML, LINE, 'infocus = "../{scene}.png"', ["outside the folder", "files.infocus"]),
    (FOLDER_TOML, LINE, 'infocus = "/data/{scene}.png"', ["outside the folder"]),
    (FOLDER_TOML, LINE, f'{LINE}\ninside = "../mine"', ["outside the folder", "inside"]),
    (FOLDER_TOML, LINE, 'infocus = "{scene}/{image}.png"', ["{image}", "4 scenes without it"]),
    (FOLDER_TOML, LINE, 'infocus = "{scene}/blurred.png"', ["one file, desk/blurred.png"]),
    (FOLDER_TOML, "capture = [1]", "capture = [1, 2]", ["desk/capture2 have the same images"]),
    (FOLDER_TOML, "{scene}/depth.png", "{scene}/{capture}.png", ["an axis of the depth"]),
    (FOLDER_TOML, SCALE, "", ["how metres become levels"]),
    (FOLDER_TOML, '"folder"', '"folder"\nrecipe = "text"', ["nothing else; got defocus"]),
    (FOLDER_TOML, DESK, NAMED, ["capture stands for something else", "scenes[0].names"]),
    (FOLDER_TOML, FOLDER_TOML[FILES], "", ["mine-1.toml: files"]),
    (FOLDER_TOML, "[table]", flat_field("[1.0]", 3), ["flat_field"]),
    (FOLDER_TOML, "[table]", flat_field("[1.0, 0.0]", 3), ["flat_field"]),
    (FOLDER_TOML, "[table]", flat_field("[1.0, 0.9]", 2), ["for red, green and blue; got 2"]),
    (STACK_TOML, IMAGES, f"{IMAGES}\nflat_field = [[1.0, 0.5]]", ["it is for pairs"]),
    (STACK_TOML, IMAGES, "", ["neither a pair", "got depth, infocus, metadata"]),
    (STACK_TOML, IMAGES, f'{IMAGES}\nmoved = "infocus"', ["laid on the first", "moved"]),
    (STACK_TOML, IMAGES, f"{IMAGES}\ndepth_ends = [2.0, 1.0]", ["values of two levels"]),
    (STACK_TOML, IMAGES, f"{IMAGES}\nimage = [{{ number = 3 }}]", ["two tables"]),
    (STACK_TOML, "f_{image}", "f", ["the pattern names one file"]),
    (STACK_TOML, IMAGES, f"{IMAGES}\naxis_names = {{ a = {{}} }}", ["no such axis: a"]),
    (STACK_TOML, "{scene}/focus.csv", "../focus.csv", ["outside the folder", "metadata"]),
    (STACK_TOML, "{scene}/focus.csv", "{place}.csv", ["known by the name {place}"]),
]


@pytest.mark.parametrize(("toml", "old", "new", "parts"), BROKEN)
def test_a_broken_manifest_says_where(toml: str, old: str, new: str, parts: list[str]) -> None:
    assert old in toml
    text = problems_of(toml.replace(old, new, 1))
    for part in ("mine-1.toml", *parts):
        assert part in text


def test_every_problem_is_in_one_message() -> None:
    wrong = TINY_TOML.replace('reader = "middlebury"', "reader = 5")
    found = problems_of(wrong.replace('title = "Tiny set"', ""))
    assert all(part in found for part in ("reader", "field is missing", "title"))
    # What fields contradict one another in is told once they are sound.
    wrong = TINY_TOML.replace("pairs = 7", "pairs = 6")
    found = problems_of(wrong.replace('test_scenes = ["Three"]', 'test_scenes = ["Four"]'))
    assert all(part in found for part in ("splits[1].pairs", "Four", "folds"))
    # Columns that are known must be the ones that patterns name.
    text = STACK_TOML.replace("{image}", "{motor}")
    parse_manifest(text.encode("utf-8-sig"), "mine-1.toml")  # some editors begin it with a mark
    found = problems_of(text.replace("[rig]", 'columns = ["run", "focus_distance"]\n\n[rig]'))
    assert "nothing is known by the name {motor}" in found
    assert "the pattern names one file" in found
