import shutil
from pathlib import Path

import numpy as np
import pytest
import zarr

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.fingerprint import combine, scene_digests
from dfdbench.datasets.integrity import StoreDifference, require_sound, verify_store
from dfdbench.errors import StoreError
from tests.conftest import rewrite_array


def local(store: Dataset) -> Path:
    return Path(store.path.path)


def test_a_sound_store(tiny_store: Dataset) -> None:
    steps: list[tuple[int, int]] = []
    found = verify_store(tiny_store, on_scene=lambda *step: steps.append(step))
    assert found.differences == ()
    assert found.sound
    assert found.recomputed == tiny_store.fingerprint
    assert (found.scenes, found.arrays) == (3, 36)
    assert steps == [(1, 3), (2, 3), (3, 3)]


def test_the_arrays_that_differ_are_named(tiny_store: Dataset) -> None:
    rewrite_array(tiny_store, "Two/depth", lambda depth: depth + 1)
    chunk = next(path for path in (local(tiny_store) / "One/images/c").rglob("0") if path.is_file())
    chunk.write_bytes(b"rot")
    shutil.rmtree(local(tiny_store) / "Three/depth")
    found = verify_store(Dataset(tiny_store.path))
    assert not found.sound
    assert found.recomputed == ""
    places = [(item.scene, item.array) for item in found.differences]
    assert places == [("One", "images"), ("Two", "depth"), ("Three", "depth")]
    assert "cannot be decoded" in found.differences[0].what
    assert found.differences[1:] == (
        StoreDifference("Two", "depth", "holds other values"),
        StoreDifference("Three", "depth", "is missing"),
    )


def test_a_scene_that_is_gone_is_named(tiny_store: Dataset) -> None:
    shutil.rmtree(local(tiny_store) / "Two")
    found = verify_store(Dataset(tiny_store.path))
    assert found.differences == (StoreDifference("Two", "", "the scene is missing"),)
    assert found.recomputed not in ("", found.recorded)


def test_what_was_added_is_named(tiny_store: Dataset) -> None:
    scene = zarr.open_group(local(tiny_store), path="One", mode="r+")
    scene.create_array("more", data=np.zeros(24), dimension_names=("y",))
    (difference,) = verify_store(Dataset(tiny_store.path)).differences
    assert (difference.array, difference.what) == ("more", "was not there when it was built")


def test_digests_changed_together_with_the_arrays_are_noticed(tiny_store: Dataset) -> None:
    rewrite_array(tiny_store, "Two/depth", np.fliplr)
    scene = zarr.open_group(local(tiny_store), path="Two", mode="r+")
    dataset = Dataset(tiny_store.path).stored("Two")
    digests = scene_digests(dataset)
    scene.attrs.update({"array_digests": digests, "digest": combine(digests)})
    found = verify_store(Dataset(tiny_store.path))
    assert not found.differences
    assert not found.sound


def test_a_store_that_is_not_as_built_is_refused_with_all_that_differs(tiny_store: Dataset) -> None:
    require_sound(tiny_store)
    for name in ("depth", "images"):
        rewrite_array(tiny_store, f"Two/{name}", lambda values: values[..., ::-1, :])
    with pytest.raises(StoreError, match="does not hold what was built") as caught:
        require_sound(Dataset(tiny_store.path))
    places = [problem.where.rpartition(", ")[2] for problem in caught.value.problems]
    assert places == ["Two/depth", "Two/images"]
