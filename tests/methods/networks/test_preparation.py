from __future__ import annotations

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.methods.networks.architectures import DfDNet, UNet
from dfdbench.methods.networks.preparation import fold_batch_norm, start_from_differences

SMALL = (4, 3, 4, 6, 5, 6, 8, 7, 8, 6, 6, 5, 6, 4, 4, 3, 4, 256)


def test_folding_changes_no_answer_and_leaves_one_normalization() -> None:
    torch.manual_seed(0)
    network = DfDNet(SMALL)
    pixels = torch.rand(4, 6, 16, 16) * 255
    for _ in range(5):  # running means that are not 0 and 1
        network(pixels)
    network.eval()
    with torch.no_grad():
        before = network(pixels)
        fold_batch_norm(network)
        assert torch.allclose(network(pixels), before, atol=1e-4)
    kinds = [type(module).__name__ for module in network.modules()]
    assert kinds.count("BatchNorm2d") == 1  # after a sum, before no convolution


@pytest.mark.parametrize("kind", ["dfd-net", "u-net"])
def test_filters_from_differences_do_not_see_brightness(kind: str) -> None:
    torch.manual_seed(0)
    network = DfDNet(SMALL) if kind == "dfd-net" else UNet((4, 8, 16, 32, 64))
    sharp = torch.randint(0, 256, (2, 3, 32, 32)).float()
    pixels = torch.cat([sharp, sharp + torch.randn(2, 3, 32, 32)], 1)
    start_from_differences(network, pixels)
    flat = torch.rand(1, 3, 1, 1).expand(1, 3, 9, 9)
    answer = network.first(torch.cat([flat, flat], 1))[:, :, 1:-1, 1:-1]
    assert answer.abs().max() < 1e-4
    # What is small in the images is as large in the answers as all else.
    deviations = network.first(network.pixels(pixels)).std((0, 2, 3))
    assert torch.allclose(deviations, torch.ones_like(deviations), atol=1e-3)
