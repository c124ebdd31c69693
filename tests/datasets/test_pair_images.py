import dataclasses

import pytest

from dfdbench.datasets.store import Store


def test_a_pair_holds_two_images_and_the_truth_of_one_size_and_stays_as_read(
    tiny_store: Store,
) -> None:
    images = tiny_store.read(tiny_store.pairs("test")[0])
    rows, columns = images.depth.shape
    assert images.infocus.shape == images.defocus.shape == (rows, columns, 3)
    assert images.valid.shape == (rows, columns)
    with pytest.raises(dataclasses.FrozenInstanceError):
        images.depth = images.depth  # type: ignore[misc]
