from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.building.folder_facts import Facts, look_into
from dfdbench.building.folder_layout import find_layout, image_files
from dfdbench.errors import InputError
from dfdbench.system.text import parse_toml
from tests.made_folder import SCENES, SHAPE, make_folder


def facts_of(folder: Path) -> Facts:
    layout = find_layout(image_files(folder))
    assert layout is not None
    return look_into(folder, layout)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_folder(tmp_path)


def rewrite(folder: Path, name: str, change: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
    for scene in SCENES:
        path = str(folder / scene / name)
        image = np.asarray(cv2.imread(path, cv2.IMREAD_UNCHANGED))
        cv2.imwrite(path, change(image))


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
        cv2.imwrite(str(folder / scene / "depth.tiff"), metres)
    facts = facts_of(folder)
    assert (facts.files["depth_unit"], facts.scale) == ("1.0 # metres", (0.3, 2.0))
    assert any("in desk 64 × 64, not 96 × 72): resample it" in text for text in facts.open)


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


def test_depth_in_metres_is_read_from_arrays(folder: Path) -> None:
    for scene in SCENES:
        (folder / scene / "depth.png").unlink()
        np.save(folder / scene / "depth.npy", np.linspace(0.3, 2.0, 72 * 96).reshape(SHAPE))
        np.save(folder / scene / "K_gt.npy", np.eye(3))
    facts = facts_of(folder)
    assert facts.roles["depth"].pattern == "{scene}/depth.npy"
    assert (facts.files["depth_unit"], facts.scale) == ("1.0 # metres", (0.3, 2.0))


def test_photographs_of_the_depth_s_size_are_taken(folder: Path) -> None:
    for scene in SCENES:
        for name in ("sharp", "blurred"):
            image = np.asarray(cv2.imread(str(folder / scene / f"{name}.png")))
            cv2.imwrite(str(folder / scene / f"raw_{name}.png"), cv2.resize(image, (192, 144)))
    facts = facts_of(folder)
    assert facts.roles["infocus"].pattern == "{scene}/sharp.png"
    assert facts.roles["defocus"].pattern == "{scene}/blurred.png"
    assert any("also there: {scene}/raw_" in text for text in facts.open)


def test_of_a_focal_stack_the_smallest_aperture_is_in_focus(folder: Path) -> None:
    for number, scene in enumerate(SCENES):
        image = np.asarray(cv2.imread(str(folder / scene / "sharp.png")))
        place = folder / ("val" if number < 2 else "test") / f"scene_{number:04}"
        (place / "stack").mkdir(parents=True)
        for run in range(1, 8):
            for f_number in ("1.4", "2.8"):
                blurred = cv2.GaussianBlur(image, (0, 0), 0.4 + run / 8)
                name = f"img_run_{run}_motor_{run:04X}_aperture_F{f_number}.jpg"
                cv2.imwrite(str(place / "stack" / name), blurred)
        # Softer than the sharpest of the stack, as diffraction makes it.
        wide = cv2.GaussianBlur(image, (0, 0), 0.8)
        cv2.imwrite(str(place / "stack/img_run_5_motor_0009_aperture_F16.0.jpg"), wide)
        if number < 2:
            (place / "gt").mkdir()
            np.save(place / "gt/depth.npy", np.full(SHAPE, 2.0, np.float32))
        for file in (folder / scene).iterdir():
            file.unlink()
    facts = facts_of(folder)
    stack = "{split}/{scene}/stack"
    assert facts.roles["infocus"].pattern == f"{stack}/img_run_5_motor_0009_aperture_F16.0.jpg"
    assert facts.roles["defocus"].pattern.startswith(f"{stack}/img_run_7_")
    assert facts.roles["depth"].pattern == "{split}/{scene}/gt/depth.npy"
    assert any("which defocus image to take: 13 more kinds" in text for text in facts.open)
