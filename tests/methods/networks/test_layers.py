import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.methods.networks.architectures import PUBLISHED_MEANS, DfDNet
from tests.methods.networks.test_architectures import SMALL


def test_means_are_taken_off_and_255_is_nearly_1() -> None:
    network = DfDNet(SMALL)
    means = torch.tensor(PUBLISHED_MEANS).reshape(1, 6, 1, 1).expand(1, 6, 4, 4)
    assert torch.equal(network.pixels(means), torch.zeros(1, 6, 4, 4))
    assert torch.allclose(network.pixels(means + 64), torch.full((1, 6, 4, 4), 0.25))
