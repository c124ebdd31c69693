import asyncio
import hashlib
import json
import re
import shutil
from collections.abc import Callable
from functools import partial
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
import zarr.storage
from zarr.core.buffer import default_buffer_prototype

from dfdbench.datasets import fingerprint
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import StoreError
from tests.conftest import rewrite_array

VALUES = np.arange(6, dtype="<i4").reshape(2, 3)


def test_what_it_holds_does_enter() -> None:
    seen = {fingerprint.array_digest("a", ("y", "x"), VALUES)}
    for name, dimensions, values in (
        ("a", ("y", "x"), VALUES + (VALUES == 5)),
        ("b", ("y", "x"), VALUES),
        ("a", ("x", "y"), VALUES),
        ("a", ("y", "x"), VALUES.astype("<i8")),
    ):
        seen.add(fingerprint.array_digest(name, dimensions, values))
    assert len(seen) == 5


def damaged(store: Dataset, place: str, change: Callable[[dict[str, Any]], object]) -> Path:
    path = Path(store.path.path) / place / "zarr.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return Path(store.path.path)


def of_attributes(edit: Callable[[Any], object]) -> Callable[[Any], object]:
    return lambda content: edit(content["attributes"])


def _double_the_blur(attributes: dict[str, Any]) -> None:
    attributes["recipe"]["parameters"]["sigma_step"] *= 2


def _shrink_the_crop(attributes: dict[str, Any]) -> None:
    edited = attributes["manifest"].replace("network_crop = 16", "network_crop = 8")
    assert edited != attributes["manifest"]
    sha256 = hashlib.sha256(edited.encode()).hexdigest()
    attributes.update(manifest=edited, manifest_sha256=sha256)


def test_a_store_whose_attributes_were_edited_is_refused(tiny_store: Dataset) -> None:
    whole = (Path(tiny_store.path.path) / "zarr.json").read_text()
    edits: list[Callable[[dict[str, Any]], object]] = [
        _double_the_blur,
        _shrink_the_crop,
        lambda attributes: attributes.update(missing_pairs=["One"]),
        lambda attributes: attributes.update(fingerprint="0" * 64),
        lambda attributes: attributes.pop("recipe"),
        lambda attributes: attributes.pop("attributes_sha256"),
    ]
    for edit in edits:
        path = damaged(tiny_store, "", of_attributes(edit))
        with pytest.raises(StoreError, match="were edited after"):
            Dataset(path)
        (path / "zarr.json").write_text(whole)


@pytest.mark.parametrize(
    ("name", "value"),
    [("recipe", 5), ("recipe", {}), ("options", None), ("missing_pairs", 5), ("fingerprint", [1])],
)
def test_attributes_of_another_type_are_told_by_name(
    tiny_store: Dataset, name: str, value: object
) -> None:
    path = damaged(
        tiny_store,
        "",
        lambda content: content.update(
            attributes=fingerprint.signed({**content["attributes"], name: value})
        ),
    )
    with pytest.raises(StoreError, match=rf"\({re.escape(str(path))}: {name}"):
        Dataset(path)


def test_a_store_of_an_edited_released_manifest_is_refused(tiny_store: Dataset) -> None:
    def forge(attributes: dict[str, Any]) -> None:
        demo = find_manifest("demo").toml
        attributes["manifest"] = demo.replace("network_crop = 224", "network_crop = 16")
        attributes["attributes_sha256"] = fingerprint.attributes_digest(attributes)

    path = damaged(tiny_store, "", lambda content: forge(content["attributes"]))
    with pytest.raises(StoreError, match="another manifest than demo-1"):
        Dataset(path)


def test_arrays_not_as_built_are_told(tiny_store: Dataset) -> None:
    changes: list[tuple[str, dict[str, Any]]] = [
        ("Two/available", {"shape": [1, 1, 1]}),
        ("Two/images", {"data_type": "float64", "fill_value": 0.0}),
        ("Two/depth", {"chunk_key_encoding": {"name": "default", "configuration": {"@": 1}}}),
        ("Two/depth", {"codecs": []}),
    ]
    for place, change in changes:
        file = Path(tiny_store.path.path) / place / "zarr.json"
        whole = file.read_text()
        path = damaged(tiny_store, place, methodcaller("update", change))
        with pytest.raises(StoreError, match="cannot be read"):
            Dataset(path).read(tiny_store.pairs("Two")[0])
        file.write_text(whole)
    assert Dataset(path).read(tiny_store.pairs("Two")[0]).valid.any()


def test_a_scene_that_cannot_be_opened_is_one_difference(tiny_store: Dataset) -> None:
    damaged(tiny_store, "Two/depth", lambda content: content.update(codecs=3))
    found = fingerprint.verify_store(tiny_store)
    assert [item.scene for item in found.differences] == ["Two"]
    assert found.recomputed == ""


def test_another_scene_record_is_told_by_name(tiny_store: Dataset) -> None:
    whole = (Path(tiny_store.path.path) / "One/zarr.json").read_text()
    for name, value in (("array_digests", "\u202e"), ("source_sha256", None), ("found", [])):
        changed: dict[str, object] = {name: value}
        path = damaged(tiny_store, "One", of_attributes(methodcaller("update", changed)))
        with pytest.raises(StoreError, match=rf"record is damaged[^:]*One: {name}"):
            fingerprint.scene_record(Dataset(path).to_xarray("One").attrs, f"{path}, One")
        (path / "One/zarr.json").write_text(whole)


@pytest.mark.parametrize("name", ["available", "depth", "images", "f_number"])
def test_a_lost_chunk_is_told_and_never_read_as_zeros(tiny_store: Dataset, name: str) -> None:
    chunk = min((Path(tiny_store.path.path) / "Two" / name).glob("c*"))
    chunk.unlink()
    with pytest.raises(StoreError, match="cannot be read") as caught:
        tiny_store.read(tiny_store.pairs("Two")[0])
    problem = caught.value.problems[0]
    assert problem.where.endswith(f"Two/{name}")
    assert f"{chunk.relative_to(tiny_store.path.path).as_posix()} is missing" in problem.got
    if name != "available":
        with pytest.raises(FileNotFoundError, match="is missing"):
            _ = tiny_store.to_xarray("Two")[name].values
    (found,) = fingerprint.verify_store(Dataset(tiny_store.path)).differences
    assert (found.scene, found.array) == ("Two", name)
    assert "cannot be decoded" in found.what


@pytest.mark.parametrize("key", ["One/depth/c.0.1", "One/depth/c/0/1", "One/focal_length/c"])
def test_what_is_a_chunk_may_not_be_absent(key: str) -> None:
    arrays = fingerprint.WholeArrays(zarr.storage.MemoryStore())
    read = partial(arrays.get, prototype=default_buffer_prototype())
    with pytest.raises(FileNotFoundError, match="is missing"):
        asyncio.run(read(key))
    assert asyncio.run(read("One/depth/zarr.json")) is None


def test_the_arrays_that_differ_are_named(tiny_store: Dataset) -> None:
    rewrite_array(tiny_store, "Two/depth", lambda depth: depth + 1)
    scene = zarr.open_group(Path(tiny_store.path.path), path="Two", mode="r+")
    scene.create_array("more", data=np.zeros(24), dimension_names=("y",))
    min((Path(tiny_store.path.path) / "One/images").glob("c*")).write_bytes(b"rot")
    shutil.rmtree(Path(tiny_store.path.path) / "Three/depth")
    found = fingerprint.verify_store(Dataset(tiny_store.path))
    assert not found.sound
    assert found.recomputed == ""
    first, *others = found.differences
    assert (first.scene, first.array) == ("One", "images")
    assert "cannot be decoded" in first.what
    assert others == [
        fingerprint.StoreDifference("Two", "depth", "holds other values"),
        fingerprint.StoreDifference("Two", "more", "was not there when it was built"),
        fingerprint.StoreDifference("Three", "depth", "is missing"),
    ]
    shutil.rmtree(Path(tiny_store.path.path) / "Two")
    found = fingerprint.verify_store(Dataset(tiny_store.path))
    assert fingerprint.StoreDifference("Two", "", "the scene is missing") in found.differences


def test_digests_changed_together_with_the_arrays_are_noticed(tiny_store: Dataset) -> None:
    rewrite_array(tiny_store, "Two/depth", np.fliplr)
    scene = zarr.open_group(Path(tiny_store.path.path), path="Two", mode="r+")
    digests = fingerprint.scene_digests(Dataset(tiny_store.path).stored("Two"))
    scene.attrs.update({"array_digests": digests, "digest": fingerprint.combine(digests)})
    found = fingerprint.verify_store(Dataset(tiny_store.path))
    assert not found.differences
    assert not found.sound


def test_a_store_that_is_not_as_built_is_refused_with_all_that_differs(tiny_store: Dataset) -> None:
    fingerprint.require_sound(tiny_store)
    for name in ("depth", "images"):
        rewrite_array(tiny_store, f"Two/{name}", lambda values: values[..., ::-1, :])
    with pytest.raises(StoreError, match="does not hold what was built") as caught:
        fingerprint.require_sound(Dataset(tiny_store.path))
    places = [problem.where.rpartition(", ")[2] for problem in caught.value.problems]
    assert places == ["Two/depth", "Two/images"]
