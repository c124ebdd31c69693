from pathlib import Path

import pytest

from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.store_place import default_store, is_place, own_stores, place_of


def test_each_version_of_a_set_has_a_place_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert default_store(find_manifest("demo"), tmp_path) == tmp_path / "stores/demo-1.zarr"
    monkeypatch.setenv("DFDBENCH_CACHE", "elsewhere")
    assert default_store(find_manifest("realworld")) == Path("elsewhere/stores/realworld-1.zarr")


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("demo", False),
        ("middlebury-third-1", False),
        ("mine.toml", False),
        ("sets/mine.toml", False),
        ("mine.zarr", True),
        ("./mine", True),
        ("/sets/mine.zarr", True),
        ("s3://bucket/mine.zarr", True),
    ],
)
def test_a_path_is_told_from_a_name(name: str, place: bool) -> None:
    assert is_place(name) is place


def test_a_set_of_ones_own_is_known_by_its_name_once_built(tmp_path: Path) -> None:
    assert own_stores(tmp_path) == {}
    stores = tmp_path / "stores"
    for name in ("lab-2", "lab-10", "lab-bench", "demo-1@noise-1", "demo-7", "lab-10.zarr.partial"):
        (stores / (name if "partial" in name else f"{name}.zarr")).mkdir(parents=True)
    assert own_stores(tmp_path) == {
        "demo-7": stores / "demo-7.zarr",
        "lab": stores / "lab-10.zarr",
        "lab-10": stores / "lab-10.zarr",
        "lab-2": stores / "lab-2.zarr",
        "lab-bench": stores / "lab-bench.zarr",
    }
    assert place_of("lab", tmp_path) == stores / "lab-10.zarr"
    assert place_of("elsewhere/lab.zarr", tmp_path) == "elsewhere/lab.zarr"
    assert place_of("demo", tmp_path) is None
    assert place_of("lab-10.toml", tmp_path) is None
