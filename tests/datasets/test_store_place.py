from pathlib import Path

import pytest

from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.store_place import default_store, is_place


def test_each_version_of_a_set_has_a_place_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert default_store(find_manifest("demo"), tmp_path) == tmp_path / "stores/demo-1.zarr"
    monkeypatch.setenv("DFDBENCH_CACHE", "elsewhere")
    places = {default_store(find_manifest(name)) for name in ("realworld-1", "realworld-2")}
    assert places == {
        Path("elsewhere/stores/realworld-1.zarr"),
        Path("elsewhere/stores/realworld-2.zarr"),
    }


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
