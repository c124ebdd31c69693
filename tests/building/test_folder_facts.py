from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import ExifTags, Image

from dfdbench.building.folder_facts import Facts, look_into
from dfdbench.building.folder_layout import find_layout, image_files
from dfdbench.errors import InputError
from dfdbench.system.text import parse_toml
from tests.made_folder import SCENES, SHAPE, built, make_folder


def facts_of(folder: Path) -> Facts:
    layout = find_layout(image_files(folder))
    assert layout is not None
    return look_into(folder, layout)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_folder(tmp_path / "mine")


def rewrite(folder: Path, name: str, change: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
    for scene in SCENES:
        path = str(folder / scene / name)
        cv2.imwrite(path, change(np.asarray(cv2.imread(path, cv2.IMREAD_UNCHANGED))))


def test_a_folder_tells_roles_unit_bounds_and_what_the_images_need(folder: Path) -> None:
    # Names that say nothing: sharpness has to.
    for scene in SCENES:
        (folder / scene / "sharp.png").rename(folder / scene / "b.png")
        (folder / scene / "blurred.png").rename(folder / scene / "a.png")
    facts = facts_of(folder)
    assert {role: group.pattern for role, group in facts.roles.items()} == {
        "infocus": "{scene}/b.png",
        "defocus": "{scene}/a.png",
        "depth": "{scene}/depth.png",
    }
    files = parse_toml("\n".join(f"{name} = {text}" for name, text in facts.files.items()))
    assert (files["depth_unit"], facts.scale) == (0.001, (1.0, 4.0))
    assert files["depth_missing"] == [0]
    assert "image_bits" not in files
    assert set(facts.shapes.values()) == {SHAPE}
    assert files["align"] != "none"
    assert files["match_gain"]
    assert any("is sharper in 4 of 4" in text for text in facts.found)
    assert any("one unit of depth is 0.001 m: the median is 2.5 m" in text for text in facts.open)


def test_levels_and_metres_are_told_from_millimetres(folder: Path) -> None:
    rewrite(folder, "depth.png", lambda depth: (depth // 20).astype(np.uint8))
    facts = facts_of(folder)
    assert facts.scale is None
    assert "depth_unit" not in facts.files
    assert any("check that these are depth levels" in text for text in facts.open)
    for scene in SCENES:
        (folder / scene / "depth.png").unlink()
        metres = np.linspace(0.3, 2.0, 64 * 64, dtype=np.float32).reshape(64, 64)
        np.save(folder / scene / "depth.npy", metres)
    facts = facts_of(folder)
    assert facts.roles["depth"].pattern == "{scene}/depth.npy"
    assert (facts.files["depth_unit"], facts.scale) == ("1.0 # metres", (0.3, 2.0))
    assert any("in desk 64 × 64, not 96 × 72): resample it" in text for text in facts.open)


def test_one_negative_value_stands_for_depth_that_is_not_known(folder: Path) -> None:
    metres = np.linspace(0.3, 2.0, SHAPE[0] * SHAPE[1], dtype=np.float32).reshape(SHAPE)
    metres[:9] = -1
    for scene in SCENES:
        (folder / scene / "depth.png").unlink()
        np.save(folder / scene / "depth.npy", metres)
    facts = facts_of(folder)
    assert facts.files["depth_missing"] == "[-1.0]"
    assert facts.files["depth_unit"] == "1.0 # metres"
    for scene in SCENES:
        (folder / scene / "depth.npy").unlink()
        np.save(folder / scene / "disparity.npy", np.where(metres > 0, 40 / metres, 0))
    facts = facts_of(folder)
    assert facts.files["depth_missing"] == "[0]"
    assert float(facts.files["depth_ends"].split("]")[0].split(",")[1]) > 19


def test_depth_of_the_size_of_turned_photographs_asks_to_turn_them(folder: Path) -> None:
    for scene in SCENES:
        for name in ("sharp.png", "blurred.png"):
            exif = Image.Exif()
            exif[ExifTags.Base.Orientation] = 6
            with Image.open(folder / scene / name) as image:
                image.rotate(90, expand=True).save(folder / scene / name, exif=exif)
    facts = facts_of(folder)
    assert facts.files["exif_rotation"] == '"apply"'
    assert not any("resample" in text for text in facts.open)
    built(folder)


def test_grey_photographs_of_16_bits_are_told_from_depth_by_its_name(folder: Path) -> None:
    for name in ("sharp.png", "blurred.png"):
        rewrite(folder, name, lambda image: image[..., 1].astype(np.uint16) * 257)
    assert facts_of(folder).roles["depth"].pattern == "{scene}/depth.png"


def test_depth_in_files_that_are_not_read_is_told(folder: Path) -> None:
    for scene in SCENES:
        (folder / scene / "depth.png").unlink()
        (folder / scene / "more.jpg").write_bytes((folder / scene / "sharp.png").read_bytes())
        (folder / scene / "depth.mat").touch()
    with pytest.raises(InputError, match=r": got .*not read: 4 \.mat"):
        facts_of(folder)


def test_photographs_of_the_depth_s_size_are_taken(folder: Path) -> None:
    for scene in SCENES:
        for name in ("sharp", "blurred"):
            image = np.asarray(cv2.imread(str(folder / scene / f"{name}.png")))
            cv2.imwrite(str(folder / scene / f"raw_{name}.png"), cv2.resize(image, (192, 144)))
    facts = facts_of(folder)
    assert facts.roles["infocus"].pattern == "{scene}/sharp.png"
    assert facts.roles["defocus"].pattern == "{scene}/blurred.png"
    assert any("also there: {scene}/raw_" in text for text in facts.open)


def test_in_doubt_the_names_tell_which_is_in_focus(folder: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (*SHAPE, 3))
    for scene in SCENES[:2]:
        cv2.imwrite(str(folder / scene / "blurred.png"), noise)
    facts = facts_of(folder)
    assert facts.roles["infocus"].pattern == "{scene}/sharp.png"
    assert any("sharpness does not tell" in text for text in facts.open)


@pytest.mark.parametrize(
    ("names", "sigma", "views"),
    [
        (("left", "right"), 0.0, True),
        (("img_L", "img_R"), 0.1, True),
        (("left", "right"), 2.0, False),
        (("im0", "im1"), 0.0, True),
        (("im0", "im1"), 2.0, False),
    ],
)
def test_the_other_view_of_a_stereo_pair_is_no_defocus(
    folder: Path, names: tuple[str, str], sigma: float, views: bool
) -> None:
    for scene in SCENES:
        (folder / scene / "sharp.png").rename(folder / scene / f"{names[0]}.png")
        (folder / scene / "blurred.png").unlink()
        first = np.asarray(cv2.imread(str(folder / scene / f"{names[0]}.png")))
        other = np.roll(first, 5, axis=1)
        other = cv2.GaussianBlur(other, (0, 0), sigma) if sigma else other
        cv2.imwrite(str(folder / scene / f"{names[1]}.png"), other)
    facts = facts_of(folder)
    assert facts.roles["infocus"].pattern == f"{{scene}}/{names[0]}.png"
    assert ("defocus" not in facts.roles) is views
    told = f"whether these are other views, as sharp, and not other blur: {{scene}}/{names[1]}.png"
    assert (told in facts.open) is views
    built(folder)


@pytest.mark.parametrize("pattern", ["light{}_{}", "{1}{0}"])
def test_of_two_lightings_both_images_are_of_one(pattern: str, folder: Path) -> None:
    for scene in SCENES:
        for name in ("sharp", "blurred"):
            image = np.asarray(cv2.imread(str(folder / scene / f"{name}.png")))
            (folder / scene / f"{name}.png").unlink()
            for light, gain in ((1, 0.7), (2, 1.0)):
                lit = (gain * image).astype(np.uint8)
                cv2.imwrite(str(folder / scene / f"{pattern.format(light, name)}.png"), lit)
    facts = facts_of(folder)
    sharp, blurred = (facts.roles[role].pattern for role in ("infocus", "defocus"))
    assert sharp.replace("sharp", "blurred") == blurred
    assert any("which defocus image to take: 2 more kinds" in text for text in facts.open)


def test_another_sharp_image_is_no_defocus_because_its_name_is_alike(folder: Path) -> None:
    for scene in SCENES:
        image = np.asarray(cv2.imread(str(folder / scene / "sharp.png")))
        (folder / scene / "sharp.png").rename(folder / scene / "day_1.png")
        cv2.imwrite(str(folder / scene / "day_2.png"), cv2.GaussianBlur(image, (0, 0), 0.4))
    facts = facts_of(folder)
    assert facts.roles["infocus"].pattern == "{scene}/day_1.png"
    assert facts.roles["defocus"].pattern == "{scene}/blurred.png"


def test_of_several_apertures_the_smallest_is_in_focus(folder: Path) -> None:
    for scene in SCENES:
        image = np.asarray(cv2.imread(str(folder / scene / "sharp.png")))
        # It is softer than the sharpest of the others, as diffraction makes it.
        for f_number, sigma in (("1.4", 1.5), ("2.8", 0.5), ("16.0", 0.8)):
            blurred = cv2.GaussianBlur(image, (0, 0), sigma)
            cv2.imwrite(str(folder / scene / f"img_F{f_number}.png"), blurred)
        for name in ("sharp.png", "blurred.png"):
            (folder / scene / name).unlink()
    facts = facts_of(folder)
    assert facts.roles["infocus"].pattern == "{scene}/img_F16.0.png"
    assert facts.roles["defocus"].pattern == "{scene}/img_F1.4.png"
    assert any("which defocus image to take: 1 more kinds" in text for text in facts.open)


def test_a_sharper_image_whose_name_tells_no_aperture_stays_in_focus(folder: Path) -> None:
    for scene in SCENES:
        image = np.asarray(cv2.imread(str(folder / scene / "sharp.png")))
        (folder / scene / "blurred.png").unlink()
        for f_number, sigma in ((2, 2.0), (4, 1.0)):
            blurred = cv2.GaussianBlur(image, (0, 0), sigma)
            cv2.imwrite(str(folder / scene / f"f{f_number}.png"), blurred)
    facts = facts_of(folder)
    assert facts.roles["infocus"].pattern == "{scene}/sharp.png"
    assert facts.roles["defocus"].pattern == "{scene}/f2.png"
