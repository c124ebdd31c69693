import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError

torch = pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.torch_pairs import TorchPairs  # noqa: E402


def test_whole_pairs(tiny_store: Dataset) -> None:
    data = TorchPairs("tiny", "test", store=tiny_store.path)
    assert len(data) == len(TorchPairs(tiny_store, "test")) == 7
    item = data[3]
    images = tiny_store.read(tiny_store.pairs("test")[3])
    assert torch.equal(item["infocus"].permute(1, 2, 0), torch.from_numpy(images.infocus))
    assert np.array_equal(item["defocus"].permute(1, 2, 0).numpy(), images.defocus)
    assert np.array_equal(item["depth"].numpy(), np.where(images.valid, images.depth, 0))
    assert np.array_equal(item["valid"].numpy(), images.valid)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 2])
def test_crops_do_not_depend_on_the_workers(tiny_store: Dataset, workers: int) -> None:
    data = TorchPairs("tiny", "all", crop=8, seed=5, store=tiny_store.path)
    loader = torch.utils.data.DataLoader(
        data,
        batch_size=4,
        num_workers=workers,
        multiprocessing_context="spawn" if workers else None,
    )
    batches = list(loader)
    assert [len(batch["depth"]) for batch in batches] == [4, 4, 3]
    assert batches[0]["infocus"].shape == (4, 3, 8, 8)
    assert torch.equal(batches[1]["infocus"][0], data[4]["infocus"])


def test_crops_change_with_the_epoch_and_come_again_if_they_fit(tiny_store: Dataset) -> None:
    data = TorchPairs("tiny", "all", crop=8, store=tiny_store.path)
    drawn = []
    for epoch in (0, 1, 0):
        data.set_epoch(epoch)
        drawn.append(torch.stack([data[number]["infocus"] for number in range(11)]))
    assert torch.equal(drawn[0], drawn[2])
    assert not torch.equal(drawn[0], drawn[1])
    for crop in (0, 25):
        with pytest.raises(InputError, match="1 to 24"):
            TorchPairs("tiny", "all", crop=crop, store=tiny_store.path)


@pytest.mark.slow
@pytest.mark.parametrize("start", ["fork", "spawn"])
def test_workers_that_stay_hear_of_the_next_epoch(tiny_store: Dataset, start: str) -> None:
    data = TorchPairs("tiny", "all", crop=8, store=tiny_store.path)
    loader = torch.utils.data.DataLoader(
        data, batch_size=11, num_workers=1, persistent_workers=True, multiprocessing_context=start
    )
    for epoch in (0, 1, 0):
        data.set_epoch(epoch)
        (batch,) = loader
        expected = torch.stack([data[number]["infocus"] for number in range(11)])
        assert torch.equal(batch["infocus"], expected)


def test_whole_images_of_several_sizes_make_a_batch(tiny_store: Dataset) -> None:
    data = TorchPairs("tiny", "all", store=tiny_store.path)
    loader = torch.utils.data.DataLoader(data, batch_size=11, collate_fn=TorchPairs.collate)
    (batch,) = loader
    assert batch["infocus"].shape == (11, 3, 24, 32)
    assert batch["size"][[0, 4, 10]].tolist() == [[24, 30], [24, 31], [24, 32]]
    for number, (rows, columns) in enumerate(batch["size"].tolist()):
        for name, values in data[number].items():
            assert torch.equal(batch[name][number][..., :rows, :columns], values)
            assert not batch[name][number][..., columns:].any()


def test_focal_stacks_of_several_sizes_make_a_batch_too() -> None:
    images, depth, focus = torch.ones(4, 3, 2, 5), torch.ones(2, 5), torch.arange(4.0)
    small = {"images": images, "depth": depth, "valid": depth > 0, "focus_distance": focus}
    large = small | {
        name: small[name].repeat_interleave(2, -1) for name in ("images", "depth", "valid")
    }
    batch = TorchPairs.collate([small, large])
    assert batch["images"].shape == (2, 4, 3, 2, 10)
    assert batch["images"].sum((1, 2, 3, 4)).tolist() == [120, 240]
    assert torch.equal(batch["focus_distance"], torch.stack([focus, focus]))
