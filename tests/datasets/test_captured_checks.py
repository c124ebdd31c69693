import pytest

from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import ManifestError
from tests.made_folder import FOLDER_TOML
from tests.made_stack_folder import STACK_TOML

LINE = 'infocus = "{scene}/sharp.png"'


def problems_of(text: str) -> str:
    with pytest.raises(ManifestError) as caught:
        parse_manifest(text.encode(), "mine-1.toml")
    return str(caught.value)


def test_a_captured_set_needs_no_voltage_steps_and_no_square() -> None:
    manifest = parse_manifest(FOLDER_TOML.encode(), "mine-1.toml")
    assert manifest.capture is None
    assert manifest.files is not None
    assert manifest.pairs()[0].id == "desk/capture1"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (LINE, 'infocus = "../{scene}.png"', ["outside the folder", "files.infocus"]),
        (LINE, 'infocus = "/data/{scene}.png"', ["outside the folder"]),
        (LINE, f'{LINE}\ninside = "../mine"', ["outside the folder", "files.inside"]),
        (LINE, 'infocus = "{scene}/{image}.png"', ["{image}", "4 scenes without it: desk"]),
        (LINE, 'infocus = "{scene}/blurred.png"', ["one file", "desk/blurred.png"]),
        ("capture = [1]", "capture = [1, 2]", ["same images", "desk/capture1 and desk/capture2"]),
        ('depth = "{scene}/depth.png"', 'depth = "{scene}/{capture}.png"', ["axis of the depth"]),
        ("[depth.scale]\nnear = 0.5\nfar = 5.0\n", "", ["how metres become levels"]),
        ('reader = "folder"', 'reader = "folder"\nrecipe = "text"', ["captured defocus has no"]),
        (
            'name = "desk"\nsource = "me"',
            'name = "desk"\nsource = "me"\nnames = { capture = "a" }',
            ["stands for something else", "scenes[0].names"],
        ),
    ],
)
def test_a_broken_captured_set_says_what_and_where(old: str, new: str, told: list[str]) -> None:
    assert old in FOLDER_TOML
    text = problems_of(FOLDER_TOML.replace(old, new, 1))
    for part in ("mine-1.toml", *told):
        assert part in text


def test_a_folder_needs_its_section() -> None:
    start, end = FOLDER_TOML.index("[files]"), FOLDER_TOML.index("[table]")
    assert "mine-1.toml: files" in problems_of(FOLDER_TOML[:start] + FOLDER_TOML[end:])


IMAGES = 'images = "{scene}/f_{image}.png"'


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (IMAGES, "", ["neither a pair nor a stack", "got depth, infocus, metadata"]),
        (IMAGES, f'{IMAGES}\ndefocus = "a"', ["neither a pair nor a stack"]),
        (IMAGES, f'{IMAGES}\nmoved = "infocus"', ["laid on the first", "files.moved"]),
        (IMAGES, f"{IMAGES}\ndepth_ends = [2.0, 1.0]", ["values of two levels"]),
        (IMAGES, f"{IMAGES}\nimage = [{{ number = 3 }}]", ["two tables"]),
        ("f_{image}", "f", ["the pattern names one file"]),
        ("near = 0.5\nfar = 5.0\n", "", ["depth.scale.near"]),
        ("[depth.scale]\nnear = 0.5\nfar = 5.0\n", "", ["how metres become levels"]),
        (IMAGES, f"{IMAGES}\naxis_names = {{ aperture = {{}} }}", ["no such axis", "aperture"]),
        ("{scene}/focus.csv", "../focus.csv", ["outside the folder", "files.metadata"]),
        ("{scene}/focus.csv", "{place}.csv", ["nothing is known by the name {place}"]),
    ],
)
def test_a_broken_stack_says_what_and_where(old: str, new: str, told: list[str]) -> None:
    assert old in STACK_TOML
    text = problems_of(STACK_TOML.replace(old, new, 1))
    for part in ("mine-1.toml", *told):
        assert part in text


def test_columns_that_are_known_must_be_the_ones_that_patterns_name() -> None:
    text = STACK_TOML.replace("{image}", "{motor}")
    parse_manifest(text.encode(), "mine-1.toml")
    named = text.replace("[rig]", 'columns = ["run", "focus_distance"]\n\n[rig]')
    text = problems_of(named)
    assert "nothing is known by the name {motor}" in text
    assert "the pattern names one file, and not several" in text
