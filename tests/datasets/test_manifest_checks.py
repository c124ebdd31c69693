import numpy as np
import pytest

from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import ManifestError
from tests.conftest import TINY_TOML


def problems_of(text: str) -> str:
    with pytest.raises(ManifestError) as caught:
        parse_manifest(text.encode(), "tiny-1.toml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("pairs = 7", "pairs = 6", ["splits[1].pairs", "expected 6", "got 7"]),
        ('scenes = ["One"]', 'scenes = ["Two"]', ["scene is in two splits", "Two"]),
        ('scenes = ["Three"]', 'scenes = ["Tree"]', ["does not exist", "Tree/view5"]),
        ("exposure = [1] }", "exposure = [2] }", ["does not exist", "exposure2"]),
        ("pair_count = 11", "pair_count = 12", ["pair_count", "11 after the exclusions"]),
        ("scene_count = 3", "scene_count = 4", ["scene_count", "3 scenes listed"]),
        ('test_scenes = ["Three"]', 'test_scenes = ["One"]', ["One in one fold", "in 2", "in 0"]),
        ("unknown = 0", "unknown = 300", ["depth.unknown", "less than or equal to 255", "300"]),
        ('reader = "middlebury"', "", ["field is missing", "reader"]),
        ('title = "Tiny set"', 'titel = "Tiny set"', ["titel", "unknown field"]),
        ('blocks = "exposure"', 'blocks = "exposition"', ["table.blocks", "did you mean exposure"]),
        ("schema_version = 1", "schema_version = 2", ["schema_version"]),
        ('name = "Two"\nsource = "here"', 'name = "One"\nsource = "here"', ["listed twice"]),
        ('name = "Two"\nsource = "here"', 'name = "Two"\nsource = "hare"', ["scenes[1].source"]),
        ("exposure = 1 }", "exposure = 7 }", ["default_lighting.exposure"]),
    ],
)
def test_a_broken_manifest_says_what_and_where(old: str, new: str, told: list[str]) -> None:
    assert old in TINY_TOML
    text = problems_of(TINY_TOML.replace(old, new, 1))
    assert "tiny-1.toml" in text
    for part in told:
        assert part in text


@pytest.mark.parametrize(
    "axis",
    [
        "available",
        "channel",
        "depth",
        "images",
        "f_number",
        "x",
        "y",
        "",
        ".",
        "..",
        "a/b",
        "zarr.json",
    ],
)
def test_an_axis_is_not_named_as_what_a_store_holds(axis: str) -> None:
    told = problems_of(TINY_TOML.replace("[axes]", f'[axes]\n"{axis}" = [1]'))
    assert "no name for an axis" in told
    assert repr(axis) in told


def test_a_scene_is_not_named_as_a_file_of_the_store() -> None:
    assert "named as a file of the store" in problems_of(TINY_TOML.replace('"Two"', '"zarr.json"'))


EXCLUSION = """[[exclusions]]
scenes = ["Three"]
coordinates = { view = [5], exposure = [1] }
pairs = 1
reason = "for the test"
"""


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("view = [1, 5]", "view = [1, 1]", ["value is listed twice", "axes.view", "[1, 1]"]),
        ('axes = ["view"]', 'axes = ["veiw"]', ["depth.axes", "did you mean view"]),
        ("illumination = 1, exposure", "illumintion = 1, exposure", ["default_lighting"]),
        (EXCLUSION, EXCLUSION * 2, ["pair is excluded twice", "exclusions[1]", "Three/view5"]),
        ("{ view = [5], ", "{ veiw = [5], ", ["exclusions[0].coordinates", "did you mean view"]),
        ('name = "test"', 'name = "train"', ["split name is taken", "splits[1].name"]),
        ('name = "test"', 'name = "all"', ["split name is taken", "all"]),
        ('name = "test"', 'name = "Two"', ["split name is taken", "Two"]),
        ('scenes = ["One"]', 'scenes = ["One", "One"]', ["listed twice", "splits[0].scenes"]),
        ('scenes = ["One"]', 'scenes = ["Onu"]', ["splits[0].scenes", "did you mean One"]),
        ('name = "K2"', 'name = "K1"', ["name is taken", "folds[1].name"]),
        ('name = "K2"', 'name = "train"', ["name is taken", "folds[1].name"]),
        ('name = "K2"', 'name = "One"', ["name is taken", "folds[1].name"]),
        ("[axes]", f'[checksums]\n"Onne/disp1.png" = "{"0" * 64}"\n\n[axes]', ["checksums"]),
    ],
)
def test_what_contradicts_itself_is_told(old: str, new: str, told: list[str]) -> None:
    assert old in TINY_TOML
    text = problems_of(TINY_TOML.replace(old, new, 1))
    for part in told:
        assert part in text


SCALED = TINY_TOML.replace(
    "[table]", '[depth.scale]\nlaw = "inverse"\nnear = 0.5\nfar = 5.0\n\n[table]'
)


def test_a_manifest_says_what_levels_are_in_metres_and_what_took_them() -> None:
    manifest = parse_manifest(
        (SCALED + "\n[rig]\nfocal_length = 0.025\ndefocus_f_number = 2.8\n").encode(), "tiny-1.toml"
    )
    assert manifest.depth.scale is not None
    assert manifest.depth.scale.to_metres(np.array([255])).tolist() == [0.5]
    assert manifest.rig is not None
    assert (manifest.rig.focal_length, manifest.rig.pixel_pitch) == (0.025, None)
    plain = parse_manifest(TINY_TOML.encode(), "tiny-1.toml")
    assert (plain.depth.scale, plain.rig) == (None, None)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("far = 5.0", "far = 0.5", ["near is not before far", "near 0.5, far 0.5"]),
        ("far = 5.0", "far = inf", ["depth.scale.far", "finite"]),
        ("far = 5.0", "far = 5.0\nnear_level = 0\nfar_level = 254", ["another way"]),
        ("far = 5.0", "far = 5.0\nfar_level = 0", ["stands for a distance as well", "0 to 255"]),
        ("[table]", "[rig]\nnear = 3.0\nfar = 2.0\n\n[table]", ["rig", "near 3, far 2"]),
    ],
)
def test_a_scale_that_contradicts_itself_is_refused(old: str, new: str, told: list[str]) -> None:
    text = problems_of(SCALED.replace(old, new, 1))
    for part in told:
        assert part in text
