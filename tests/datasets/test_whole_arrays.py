from __future__ import annotations

from pathlib import Path

import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.integrity import verify_store
from dfdbench.errors import StoreError


@pytest.mark.parametrize("name", ["available", "depth", "images", "f_number"])
def test_a_lost_chunk_is_told_and_never_read_as_zeros(tiny_store: Dataset, name: str) -> None:
    place = Path(tiny_store.path.path) / "Two" / name / "c"
    chunk = sorted(path for path in [place, *place.rglob("*")] if path.is_file())[0]
    chunk.unlink()
    with pytest.raises(StoreError, match="cannot be read") as caught:
        tiny_store.read(tiny_store.pairs("Two")[0])
    problem = caught.value.problems[0]
    assert problem.where.endswith(f"Two/{name}")
    assert f"{chunk.relative_to(tiny_store.path.path).as_posix()} is missing" in problem.got
    if name != "available":
        with pytest.raises(FileNotFoundError, match="is missing"):
            _ = tiny_store.to_xarray("Two")[name].values
    (found,) = verify_store(Dataset(tiny_store.path)).differences
    assert (found.scene, found.array) == ("Two", name)
    assert "cannot be decoded" in found.what
