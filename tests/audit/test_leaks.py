from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.audit import leaks as likeness
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from tests.conftest import store_of
from tests.made_folder import photograph


def distance(one: NDArray[np.uint8], other: NDArray[np.uint8 | np.uint16]) -> int:
    return int((likeness.image_hash(one) != likeness.image_hash(other)).sum())


@pytest.mark.parametrize("seed", range(5))
def test_one_image_in_another_guise_is_found_and_another_image_is_not(seed: int) -> None:
    image = photograph(seed)
    guises = {
        "exposure": np.asarray(image * 0.4, np.uint8),
        "gamma": np.asarray(255 * (image / 255) ** 1.8, np.uint8),
        "size": cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA),
        "crop": image[2:-2, 2:-2],
    }
    for name, guise in guises.items():
        assert distance(image, np.asarray(guise, np.uint8)) <= likeness.NEAR_DUPLICATE_BITS, name
    assert distance(image, photograph(seed + 100)) > 80


def test_an_image_of_16_bits_has_the_hash_of_its_8() -> None:
    image = photograph(0)
    assert distance(image, image.astype(np.uint16) * 257) == 0


def test_scenes_and_textures_in_both_splits_are_leaks() -> None:
    realworld = find_manifest("realworld")
    train, test = realworld.scenes_of("train"), realworld.scenes_of("test")
    assert not likeness.manifest_leaks(realworld, train, realworld, test)
    found = likeness.manifest_leaks(realworld, ("k00", "k05"), realworld, ("k01", "k05"))
    assert [(leak.kind, leak.train, leak.test) for leak in found] == [
        ("scene", "k05", "k05"),
        ("texture", "k00", "k01"),
    ]
    assert not likeness.manifest_leaks(realworld, ("k00",), find_manifest("demo"), ("k00",))


def test_data_sets_made_from_the_same_files_share_their_scenes() -> None:
    whole, default = find_manifest("middlebury"), find_manifest("middlebury-default")
    found = likeness.manifest_leaks(whole, ("Art", "Aloe"), default, ("Art", "Books"))
    assert [(leak.kind, leak.test) for leak in found] == [("scene", "Art")]
    # Scenes of one name that come from elsewhere are others.
    moved = {"url": "https://example.org"}
    elsewhere = [source.model_copy(update=moved) for source in whole.sources]
    other = whole.model_copy(update={"sources": elsewhere})
    assert not likeness.manifest_leaks(other, ("Art",), default, ("Art",))


@pytest.mark.slow
def test_a_copied_image_under_another_name_is_found_and_keeps_scenes_together(
    tiny_manifest: Manifest, tiny_folder: Path, tmp_path: Path
) -> None:
    for number, scene in enumerate(("One", "Two", "Three")):
        for view in (1, 5):
            image = cv2.resize(photograph(10 * number + view), (30 + number, 24))
            place = tiny_folder / scene / f"Illum1/Exp1/view{view}.png"
            cv2.imwrite(str(place), image)
    copied = np.asarray(cv2.imread(str(tiny_folder / "One/Illum1/Exp1/view1.png")))
    darker = cv2.resize((copied * 0.6).astype(np.uint8), (32, 24))
    cv2.imwrite(str(tiny_folder / "Three/Illum1/Exp1/view1.png"), darker)
    store = store_of(tiny_manifest, tiny_folder, tmp_path / "s.zarr")
    hashes = likeness.scene_hashes(store, tiny_manifest.scene_names)
    leaks = likeness.image_leaks({"One": hashes["One"]}, {n: hashes[n] for n in ("Two", "Three")})
    assert [(leak.train, leak.test) for leak in leaks] == [("One/view1", "Three/view1")]
    assert "bits" in leaks[0].as_problem().what
    assert likeness.scenes_alike(tiny_manifest, hashes) == [("One", "Three"), ("Two",)]
    assert likeness.image_leaks({}, hashes) == []
