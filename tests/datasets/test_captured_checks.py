import pytest

from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import ManifestError
from tests.made_folder import FOLDER_TOML

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
