import numpy as np
import pytest
import torch

from dfdbench.methods.networks.volume import mean_and_variance

DEPTHS = torch.tensor([2.0, 5.0, 11.0])


def test_mean_and_variance_are_those_of_the_mixture() -> None:
    random = np.random.default_rng(0)
    logits = random.normal(size=(3, 4, 5))
    mask = random.normal(size=(36, 4, 5))
    given = torch.from_numpy(logits)[None], torch.from_numpy(mask)[None]
    mean, variance = mean_and_variance(*given, DEPTHS.double())
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
