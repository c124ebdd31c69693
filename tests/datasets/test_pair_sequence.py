from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.datasets.pair_sequence import open_pairs
from dfdbench.datasets.store import Store
from dfdbench.errors import InputError, StoreError, UnknownNameError


def test_pairs_are_read_when_they_are_asked_for(tiny_store: Store) -> None:
    data = open_pairs("tiny", "test", store=tiny_store.path)
    assert len(data) == 7
    assert [images.pair for images in data] == list(tiny_store.pairs("test"))
    expected = tiny_store.read(tiny_store.pairs("test")[-1])
    assert np.array_equal(data[-1].defocus, expected.defocus)
    assert data[0].infocus.shape == (24, 31, 3)
    assert data[0].depth.dtype == np.uint8
    assert data[0].valid.dtype == np.bool_
    part = data[2:5]
    assert len(part) == 3
    assert part[0].pair == data[2].pair
    for read in (data.__getitem__, data.crop):
        with pytest.raises(IndexError, match=r"no pair 7: <7 pairs of .*> has 0 to 6"):
            read(7)
    wrong: Any = "One/1"
    with pytest.raises(TypeError, match=r"found by its place, as data\[0\]; got 'One/1'"):
        data[wrong]
    assert "7 pairs of" in repr(data)


def test_a_crop_decodes_its_own_pair_only(tiny_store: Store) -> None:
    data = open_pairs(str(tiny_store.path))
    region = (slice(4, 12), slice(10, 26))
    whole = data[1]
    for name in ("infocus", "defocus", "depth", "valid"):
        crop = getattr(data.crop(1, region), name)
        assert np.array_equal(crop, getattr(whole, name)[region])
    # With every other image of the scene damaged, the crop is still read.
    local = Path(tiny_store.path.path)
    for chunk in (local / "One/infocus/c").rglob("*"):
        if chunk.is_file() and "/0/0/1/" not in chunk.as_posix():
            chunk.write_bytes(b"rot")
    assert np.array_equal(data.crop(1, region).infocus, whole.infocus[region])
    with pytest.raises(StoreError, match="dfdbench verify"):
        data.crop(0, region)


@pytest.mark.parametrize(
    ("region", "told"),
    [
        ((slice(20, 28), slice(0, 8)), "rows.*20 to 28"),
        ((slice(0, 8), slice(0, 31)), "columns.*0 to 31"),
        ((slice(-4, 4), slice(0, 8)), "rows.*-4 to 4"),
        ((slice(8, 8), slice(-99, None)), "rows.*8 to 8.*columns.*-99"),
    ],
)
def test_a_crop_beyond_the_image_is_refused(
    tiny_store: Store, region: tuple[slice, slice], told: str
) -> None:
    data = open_pairs("tiny", "One", store=tiny_store.path)
    with pytest.raises(InputError, match=f"(?s){told}"):
        data.crop(0, region)
    assert data.crop(0, (slice(16, 24), slice(-8, None))).depth.shape == (8, 8)


@pytest.mark.parametrize("region", [(0, 0), (slice(0, 3),), slice(0, 3)])
def test_a_region_is_two_slices(tiny_store: Store, region: object) -> None:
    data = open_pairs("tiny", "One", store=tiny_store.path)
    with pytest.raises(InputError, match="two slices"):
        data.crop(0, region)  # type: ignore[arg-type]


def test_scenes_are_arrays_with_names(tiny_store: Store) -> None:
    scene = open_pairs("tiny", store=tiny_store.path).scene("Two")
    image = scene["infocus"].sel(view=5, illumination=1, exposure=0)
    assert image.dims == ("y", "x", "channel")
    assert image.shape == (24, 31, 3)


def test_mistakes(tiny_store: Store, tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="dfdbench build demo"):
        open_pairs("demo")
    with pytest.raises(UnknownNameError, match="did you mean demo"):
        open_pairs("deno")
    with pytest.raises(UnknownNameError, match="did you mean test"):
        open_pairs("tiny", "tets", store=tiny_store.path)
    with pytest.raises(UnknownNameError, match="did you mean Two"):
        open_pairs("tiny", store=tiny_store.path).scene("Twoo")
