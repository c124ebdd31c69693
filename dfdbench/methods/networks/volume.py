"""A small network that reads a volume of costs: how well the blur of each depth explains a pixel.

The blur is the camera's own, measured on training captures, so the network works for another camera
without new training.
"""

import itertools
import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

#: The cost at which costs are cut off, in nats above a pixel's least.
MOST = 25.0
#: The guide's channels after two by two pixels are merged into one.
_GUIDE = 4
# How often the coarsest block is repeated. Where there is no texture, depth comes from afar, and
# each repeat reaches 64 pixels further without more parameters.
_TURNS = 2
# Rows per softmax.
_ROWS = 32
# Three by three neighbours for each of two by two pixels.
NEIGHBOURS, _PIXELS = 9, 4


class VolumeNet(nn.Module):
    """Read depth from costs: a U-Net of residual blocks at half the images' resolution.

    Each of the coarser scales sees the costs again, averaged over its larger pixels: where there is
    little texture, many pixels together say what one cannot.

    Parameters
    ----------
    levels : int
        The number of depth levels in the volume, evenly spaced over the scale.
    widths : sequence of int
        Channels of each scale, the finest first.

    Examples
    --------
    >>> network = VolumeNet(levels=8, widths=(4, 6))
    >>> volume, told = torch.zeros(1, 8, 12, 16), torch.zeros(1, 1, 12, 16)
    >>> guide, prior = torch.zeros(1, 1, 24, 32), torch.zeros(1, 8)
    >>> logits, mask = network(volume, volume, told, guide, prior)
    >>> tuple(logits.shape), tuple(mask.shape)
    ((1, 8, 12, 16), (1, 36, 12, 16))
    """

    def __init__(self, levels: int = 32, widths: Sequence[int] = (40, 48, 48, 48, 48)) -> None:
        super().__init__()
        steps = list(itertools.pairwise(widths))
        self.levels = levels
        #: Rows and columns of the volume have to be multiples of this.
        self.multiple = 2 ** len(steps)
        self.stem = _convolution(2 * levels + 1 + _GUIDE, widths[0])
        self.prior = nn.Linear(levels, widths[0])
        self.blocks = nn.ModuleList(_Residual(width) for width in widths)
        self.down = nn.ModuleList(_convolution(fine, coarse, step=2) for fine, coarse in steps)
        self.costs = nn.ModuleList(nn.Conv2d(levels, coarse, 1) for _, coarse in steps)
        self.up = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in steps)
        self.joined = nn.ModuleList(_convolution(2 * fine, fine) for fine, _ in steps)
        self.last = _convolution(widths[0], widths[0])
        self.logits = nn.Conv2d(widths[0], levels, 1)
        self.mask = nn.Conv2d(widths[0], NEIGHBOURS * _PIXELS, 1)
        #: The weights of the costs themselves, of those along paths and of the prior in the answer.
        self.weights = nn.Parameter(torch.tensor([0.3, 0.3, 0.3]))

    def forward(
        self, volume: Tensor, paths: Tensor, told: Tensor, guide: Tensor, prior: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return logits over levels, and each pixel's weights for its neighbours.

        Parameters
        ----------
        volume : Tensor, shape (n, level, y, x)
            Costs in nats above the pixel's least, at most `MOST`; half the images' resolution.
        paths : Tensor, of that shape
            The same, summed along paths.
        told : Tensor, shape (n, 1, y, x)
            Log of one plus the distance between the scale's two ends, in units of noise.
        guide : Tensor, shape (n, 1, 2 y, 2 x)
            The in-focus image with its contrast evened out.
        prior : Tensor, shape (n, level)
            Log frequency of each level in training, 0 for the most frequent.

        Returns
        -------
        logits : Tensor of float32, shape (n, level, y, x)
        mask : Tensor of float32, shape (n, 36, y, x)
            See `mean_and_variance`.
        """
        # Name a large tensor only if it is needed again, since a name keeps it in memory.
        last = torch.cat((told / 3 - 1, functional.pixel_unshuffle(guide, 2)), 1)
        # Use the layout of the costs, which would otherwise be copied to join them.
        last = last.contiguous(memory_format=torch.channels_last)
        x = torch.cat((volume, paths, last), 1)
        _see(x[:, : 2 * self.levels])
        x = functional.relu_(self.stem(x).add_(self.prior(prior / 4 + 1)[:, :, None, None]))
        x = self.blocks[0](x)
        scales, costs = [x], volume
        for down, look, block in zip(self.down, self.costs, self.blocks[1:], strict=True):
            costs = functional.avg_pool2d(costs, 2)
            x = functional.relu_(down(x).add_(look(_see(costs - costs.amin(1, keepdim=True)))))
            x = block(x)
            scales.append(x)
        x = scales.pop()
        for _ in range(_TURNS):
            x = self.blocks[-1](x)
        for up, joined in zip(reversed(self.up), reversed(self.joined), strict=True):
            finer = functional.interpolate(up(x), scale_factor=2, mode="bilinear")
            x = functional.relu_(joined(torch.cat([scales.pop(), finer], 1)))
        x = functional.relu_(self.last(x))
        own, along, before = self.weights
        logits = self.logits(x).float().sub_(own * volume).sub_(along * paths)
        return logits.add_(before * prior[:, :, None, None]), self.mask(x).float()


def mean_and_variance(logits: Tensor, mask: Tensor, depths: Tensor) -> tuple[Tensor, Tensor]:
    """Return mean and variance of each pixel's distribution of depth, at full resolution.

    A pixel's distribution is a mixture of those of the three by three larger pixels around it. Each
    pixel has its own shares, so that depth edges are as sharp as those of the image.

    Parameters
    ----------
    logits : Tensor, shape (n, level, y, x)
    mask : Tensor, shape (n, 9 k^2, y, x)
        Logits of the nine shares for each of k by k pixels.
    depths : Tensor, shape (level,) or (n, level)
        The depth of each level.

    Returns
    -------
    mean, variance : Tensor, shape (n, k y, k x)

    Notes
    -----
    The shares are those of Teed and Deng's convex upsampling (RAFT, ECCV 2020).

    Examples
    --------
    >>> logits = torch.tensor([0.0, 0.0, -99.0]).reshape(1, 3, 1, 1)
    >>> mean, variance = mean_and_variance(logits, torch.zeros(1, 36, 1, 1), torch.arange(3.0))
    >>> mean[0].tolist(), variance[0, 0].tolist()
    ([[0.5, 0.5], [0.5, 0.5]], [0.25, 0.25])
    """
    n, _, rows, columns = logits.shape
    shares, pixels = _shares(logits), mask.shape[1] // NEIGHBOURS
    each = "nl" if depths.dim() > 1 else "l"
    moments = torch.stack(
        [torch.einsum(f"nlyx,{each}->nyx", shares, depths**power) for power in (1, 2)], 1
    )
    around = functional.pad(moments, (1, 1, 1, 1), mode="replicate")
    near = functional.unfold(around, 3).view(n, 2, NEIGHBOURS, rows, columns)
    taken = _shares(mask.view(n, NEIGHBOURS, pixels, rows, columns))
    # Sum planes: a matrix product would be a tiny one, two by nine, for each pixel.
    each_one = zip(near.unbind(2), taken.unbind(1), strict=True)
    fine = sum((there[:, :, None] * share[:, None] for there, share in each_one), torch.zeros(()))
    fine = functional.pixel_shuffle(fine.flatten(1, 2), math.isqrt(pixels))
    mean = fine[:, 0]
    return mean, (fine[:, 1] - mean**2).clamp_min(0)


def _shares(logits: Tensor) -> Tensor:
    # In bands, because softmax over this axis copies its input, and the copy should fit in a cache.
    return torch.cat([band.softmax(1) for band in torch.split(logits, _ROWS, -2)], -2)


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.first, self.second = _convolution(width, width), _convolution(width, width)

    def forward(self, x: Tensor) -> Tensor:
        inner: Tensor = self.second(functional.relu_(self.first(x)))
        return functional.relu_(inner.add_(x))


def _convolution(before: int, after: int, step: int = 1) -> nn.Conv2d:
    return nn.Conv2d(before, after, 3, step, 1)


def _see(costs: Tensor) -> Tensor:
    # The root makes differences of hundredths of a nat easier to see. It overwrites the costs.
    return costs.sqrt_().mul_(2 / MOST**0.5).sub_(1)
