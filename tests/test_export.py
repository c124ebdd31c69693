from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.build import build_store
from dfdbench.catalog import find_manifest
from dfdbench.errors import StoreError
from dfdbench.export import export_png
from dfdbench.manifest import Manifest
from dfdbench.sources import open_source
from dfdbench.store import Store
from tests.conftest import write_png


def test_what_is_exported_builds_the_same_store_again(
    tiny_manifest: Manifest, tiny_store: Store, tmp_path: Path
) -> None:
    assert export_png(tiny_store, tmp_path / "png") == 11
    assert (tmp_path / "png/One/Illum1/Exp0/view1_lin_0.32_2.88.png").exists()
    assert not (tmp_path / "png/Three/Illum1/Exp1/view5.png").exists()
    source = open_source(tiny_manifest, tmp_path / "png")
    report = build_store(tiny_manifest, source, tmp_path / "again.zarr")
    assert report.fingerprint == tiny_store.fingerprint


def test_only_a_split_and_nothing_is_overwritten(tiny_store: Store, tmp_path: Path) -> None:
    assert export_png(tiny_store, tmp_path, "One") == 4
    assert not (tmp_path / "Two").exists()
    times = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.png")}
    export_png(tiny_store, tmp_path, "One")
    assert times == {path: path.stat().st_mtime_ns for path in times}
    mine = tmp_path / "One/Illum1/Exp0/view1.png"
    write_png(mine, np.zeros((3, 3), np.uint8))
    before = mine.read_bytes()
    with pytest.raises(StoreError, match="holds something else"):
        export_png(tiny_store, tmp_path, "One")
    assert mine.read_bytes() == before


def test_the_published_images_come_out_again(
    shared_data: Path, tmp_path: Path, read_image: Callable[[Path], NDArray[np.uint8]]
) -> None:
    manifest = find_manifest("middlebury")
    source = open_source(manifest, shared_data / "middlebury")
    build_store(manifest, source, tmp_path / "m.zarr")
    export_png(Store(tmp_path / "m.zarr"), tmp_path / "png", "Aloe")
    for exposure in (1, 2):
        ours = tmp_path / f"png/Aloe/Illum1/Exp{exposure}/view1_lin_0.32_2.88.png"
        name = f"Illum1_Exp{exposure}_view1_lin_0.32_2.88.png"
        theirs = shared_data / "published_blur/Aloe" / name
        assert np.array_equal(read_image(ours), read_image(theirs))
        infocus = tmp_path / f"png/Aloe/Illum1/Exp{exposure}/view1.png"
        original = shared_data / f"middlebury/ThirdSize/Aloe/Illum1/Exp{exposure}/view1.png"
        assert np.array_equal(read_image(infocus), read_image(original))
