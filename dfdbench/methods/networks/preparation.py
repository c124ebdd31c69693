"""What is done to a whole network: how its first filters start, batch normalization folded."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dfdbench.methods.networks.architectures import DfDNet, UNet
from dfdbench.methods.networks.layers import Convolved


@torch.no_grad()
def start_from_differences(network: DfDNet | UNet, pixels: Tensor) -> None:
    """Let a network, still random, look for blur rather than for brightness.

    One half of the first filters takes the difference of the two images, the other the in-focus
    image's own detail: they no longer see how bright it is. Both are small where brightness is
    large; the filters are scaled so that each answers with a deviation of one (Mishkin and
    Matas 2016), or a network without batch normalization would hardly notice them. Not of the
    thesis.

    Parameters
    ----------
    network : DfDNet or UNet
        Its first convolution is changed in place.
    pixels : Tensor
        Images such as it will be trained on, shape (n, 6, y, x).
    """
    convolution = network.first
    assert isinstance(convolution, nn.Conv2d)
    weights = convolution.weight
    half = weights.shape[0] // 2
    weights[:half, 3:] = -weights[:half, :3]
    weights[half:, :3] -= weights[half:, :3].mean((2, 3), keepdim=True)
    weights[half:, 3:] = 0
    answers = convolution(network.pixels(pixels.to(weights.device)))
    weights /= answers.std((0, 2, 3)).clamp(min=1e-3).reshape(-1, 1, 1, 1)


def fold_batch_norm(network: nn.Module) -> nn.Module:
    """Put batch normalization into the convolutions before it, in place; for inference only.

    Parameters
    ----------
    network : nn.Module
        In evaluation mode.

    Examples
    --------
    >>> from dfdbench.methods.networks.widths import FILTERS
    >>> network = DfDNet(FILTERS["B-01-01"]).eval()
    >>> image = torch.full((1, 6, 8, 8), 100.0)
    >>> before = network(image)
    >>> torch.allclose(fold_batch_norm(network)(image), before, atol=1e-4)
    True
    """
    for module in network.modules():
        if isinstance(module, Convolved):
            module.fold()
    return network
