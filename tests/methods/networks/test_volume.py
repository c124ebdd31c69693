import numpy as np
import pytest
import torch

from dfdbench.methods.networks.volume import MOST, VolumeNet, mean_and_variance
from dfdbench.methods.networks.weights import count_parameters

DEPTHS = torch.tensor([2.0, 5.0, 11.0])


def test_mean_and_variance_are_those_of_the_mixture() -> None:
    random = np.random.default_rng(0)
    logits = random.normal(size=(3, 4, 5))
    mask = random.normal(size=(36, 4, 5))
    mean, variance = mean_and_variance(
        torch.from_numpy(logits)[None], torch.from_numpy(mask)[None], DEPTHS.double()
    )
    shares = np.exp(logits) / np.exp(logits).sum(0)
    for y, x in [(0, 0), (3, 9), (5, 4), (7, 2)]:
        row, column = y // 2, x // 2
        # Of 36: a neighbour, then which of the two by two pixels.
        own = np.exp(mask.reshape(9, 4, 4, 5)[:, (y % 2) * 2 + x % 2, row, column])
        mixture = np.zeros(3)
        for neighbour, share in enumerate(own / own.sum()):
            there = (
                np.clip(row + neighbour // 3 - 1, 0, 3),
                np.clip(column + neighbour % 3 - 1, 0, 4),
            )
            mixture += share * shares[:, there[0], there[1]]
        expected = mixture @ DEPTHS.numpy()
        assert mean[0, y, x].item() == pytest.approx(expected)
        spread = mixture @ np.square(DEPTHS.numpy() - expected)
        assert variance[0, y, x].item() == pytest.approx(spread)


def test_the_shipped_size_is_small_and_its_answer_shifts_with_the_image() -> None:
    network = VolumeNet().eval()
    assert count_parameters(network) <= 500_000
    generator = torch.Generator().manual_seed(0)
    volume = MOST * torch.rand((1, 32, 64, 96), generator=generator)
    told, guide = torch.rand((1, 1, 64, 96)), torch.rand((1, 1, 128, 192))
    prior = torch.zeros(1, 32)
    with torch.inference_mode():
        whole = network(volume, volume, told, guide, prior)[0]
        cut = volume[..., 32:]
        part = network(cut, cut, told[..., 32:], guide[..., 64:], prior)[0]
    # Far from the cut; coarser scales see far.
    assert (whole[..., 80:] - part[..., 48:]).abs().max() < 0.1 * whole.abs().max()
