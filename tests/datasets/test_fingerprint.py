import numpy as np
import pytest
import xarray

from dfdbench.datasets.fingerprint import array_digest, combine, scene_digests


def test_memory_layout_and_byte_order_do_not_enter() -> None:
    values = np.arange(24, dtype="<i4").reshape(2, 3, 4)
    plain = array_digest("a", ("z", "y", "x"), values)
    assert array_digest("a", ("z", "y", "x"), values.astype(">i4")) == plain
    assert array_digest("a", ("z", "y", "x"), np.asfortranarray(values)) == plain


@pytest.mark.parametrize("change", ["value", "name", "dimension", "type", "shape"])
def test_what_it_holds_does_enter(change: str) -> None:
    values = np.arange(6, dtype="<i4").reshape(2, 3)
    name, dimensions, other = "a", ("y", "x"), values.copy()
    if change == "value":
        other[1, 2] = 7
    elif change == "name":
        name = "b"
    elif change == "dimension":
        dimensions = ("x", "y")
    elif change == "type":
        other = values.astype("<i8")
    else:
        other = values.reshape(3, 2)
    assert array_digest(name, dimensions, other) != array_digest("a", ("y", "x"), values)


def test_coordinates_enter_a_scene() -> None:
    scene = xarray.Dataset({"depth": (("view",), [1, 2])}, coords={"view": [1, 5]})
    moved = scene.assign_coords(view=[1, 6])
    assert combine(scene_digests(scene)) != combine(scene_digests(moved))
