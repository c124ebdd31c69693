"""A small network that reads a focal stack: at which focus each pixel's contrast is greatest.

All images go through the same filters, and depth follows from how their outputs differ along the
focus. So the network takes any number of images, at any distances, from any camera.
"""

import itertools
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from dfdbench.methods.networks.architectures import in_float32
from dfdbench.methods.networks.volume import NEIGHBOURS

#: The side of a cell of pixels, which the network sees as one; and the number of depths that it
#: distinguishes for each image: at its focus, nearer and farther.
CELL, DEPTHS = 4, 3
# The side of the first filters, and the least contrast, relative to the images' mean.
_SIDE, _LEAST = 5, 2e-3


def places_of(focus: Tensor) -> Tensor:
    """Return the positions of the depths that the network distinguishes, ascending: (n, 3 images).

    Besides each focus, they are a third of the way to the next one on either side, and twice as far
    beyond the outermost.

    Parameters
    ----------
    focus : Tensor, shape (n, image)
        The focus of each image, ascending.

    Examples
    --------
    >>> places_of(torch.tensor([[0.0, 3.0, 9.0]])).tolist()
    [[-2.0, 0.0, 1.0, 2.0, 3.0, 5.0, 7.0, 9.0, 13.0]]
    """
    below, above = _steps(focus)
    return torch.stack([focus - below / 3, focus, focus + above / 3], 2).flatten(1)


def _steps(focus: Tensor) -> tuple[Tensor, Tensor]:
    step = focus.diff(dim=1)
    return torch.cat([2 * step[:, :1], step], 1), torch.cat([step, 2 * step[:, -1:]], 1)


class StackNet(nn.Module):
    """Read depth from a focal stack: contrast by learned filters, compared along the focus.

    The log of the filters' mean contrast in cells of 4 x 4 pixels, minus its maximum over the
    images, goes through a U-Net. Its blocks exchange features between neighbours along the focus,
    and the maximum over all images. Each image votes on three depths, and a softmax over all of
    them is the answer.

    Parameters
    ----------
    filters : int
        The number of filters of the first layer.
    widths : sequence of int
        Channels of each scale, the finest first.

    Notes
    -----
    The shared features, their maximum over the stack and the differences along the focus are in
    the spirit of DefocusNet (Maximov et al., CVPR 2020) and of the differential focus volume of
    Yang et al. (CVPR 2022).

    Examples
    --------
    >>> network = StackNet(filters=4, widths=(4, 6))
    >>> logits, mask = network(torch.zeros(1, 3, 16, 24), torch.tensor([[0.0, 1.0, 2.0]]))
    >>> tuple(logits.shape), tuple(mask.shape)
    ((1, 9, 4, 6), (1, 144, 4, 6))
    """

    def __init__(self, filters: int = 16, widths: Sequence[int] = (24, 40, 64, 64)) -> None:
        super().__init__()
        steps = list(itertools.pairwise(widths))
        #: Rows and columns of the images have to be multiples of this.
        self.multiple = CELL * 2 ** len(steps)
        self.filters = nn.Conv2d(1, filters, _SIDE, bias=False)
        # Contrast, contrast minus its maximum, and the mean of the cell; the focus and its steps.
        self.stem = nn.Conv2d(2 * filters + 4, widths[0], 3, padding=1)
        self.before = nn.ModuleList(_Block(width) for width in widths)
        self.down = nn.ModuleList(
            nn.Conv2d(fine, coarse, 3, 2, padding=1) for fine, coarse in steps
        )
        self.up = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in steps)
        self.after = nn.ModuleList(_Block(fine) for fine, _ in steps)
        self.logits = nn.Conv2d(widths[0], DEPTHS, 1)
        self.guide = nn.Conv2d(CELL**2, widths[0], 3, padding=1)
        self.mask = nn.Conv2d(widths[0], NEIGHBOURS * CELL**2, 1)
        #: The weight of the filters' mean contrast itself in the answer.
        self.weight = nn.Parameter(torch.tensor(3.0))

    def forward(self, images: Tensor, focus: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits over the depths of `places_of`, and pixels' weights for their neighbours.

        Parameters
        ----------
        images : Tensor, shape (n, image, y, x)
            Grey images in order of the focus, with a mean of about 1.
        focus : Tensor, shape (n, image)
            The focus of each image, ascending, on any scale along which blur grows.

        Returns
        -------
        logits : Tensor of float32, shape (n, 3 images, y / 4, x / 4)
        mask : Tensor of float32, shape (n, 144, y / 4, x / 4)
            See `mean_and_variance`.
        """
        n, count = images.shape[:2]
        # One image at a time, because the filters' outputs take the most memory.
        each = [in_float32(self._contrast, image) for image in torch.split(images.flatten(0, 1), 1)]
        contrast = torch.cat(each).view(n, count, -1, *(size // CELL for size in images.shape[2:]))
        contrast = contrast - contrast.mean((1, 3, 4), keepdim=True)
        less = contrast - contrast.amax(1, keepdim=True)
        cells = functional.avg_pool2d(images, CELL)
        span = (focus[:, -1:] - focus[:, :1]) / 2
        facts = torch.stack(
            [(focus - focus.mean(1, keepdim=True)) / span, *(step / span for step in _steps(focus))]
        )
        known = facts.permute(1, 2, 0)[..., None, None].expand(-1, -1, -1, *cells.shape[2:])
        x = torch.cat([contrast / 2, less, cells[:, :, None], known], 2).flatten(0, 1)
        x = self.before[0](functional.relu(self.stem(x)), count)
        scales = [x]
        for down, block in zip(self.down, self.before[1:], strict=True):
            x = block(functional.relu(down(x)), count)
            scales.append(x)
        x = scales.pop()
        for up, block in zip(reversed(self.up), reversed(self.after), strict=True):
            finer = functional.interpolate(up(x), scale_factor=2, mode="bilinear")
            x = block(functional.relu(scales.pop() + finer), count)
        own = self.weight * less.mean(2, keepdim=True)
        logits = self.logits(x).view(n, count, DEPTHS, *x.shape[2:]).float() + own
        return logits.flatten(1, 2), self._mask(x, logits, images)

    def _contrast(self, image: Tensor) -> Tensor:
        # Remove the filters' mean, since brightness alone is not contrast.
        weight = self.filters.weight - self.filters.weight.mean((2, 3), keepdim=True)
        edge = (_SIDE // 2,) * 4
        found = functional.conv2d(functional.pad(image[None], edge, mode="replicate"), weight)
        return (functional.avg_pool2d(found.abs(), CELL) + _LEAST).log()

    def _mask(self, x: Tensor, logits: Tensor, images: Tensor) -> Tensor:
        """Return which neighbours pixels resemble, using an image fused from all in-focus parts."""
        shares = logits.flatten(1, 2).softmax(1).view(logits.shape).sum(2)
        whole = functional.interpolate(shares, scale_factor=CELL)
        sharp = functional.pixel_unshuffle((whole * images).sum(1, keepdim=True), CELL)
        most = x.view(*images.shape[:2], *x.shape[1:]).amax(1)
        level = sharp.mean(1, keepdim=True).clamp_min(_LEAST)
        mask: Tensor = self.mask(functional.relu(most + self.guide((sharp - level) / level)))
        return mask.float()


class _Block(nn.Module):
    """A residual block over an image's pixels, its neighbours along the focus, and the maximum."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.around = nn.Conv2d(width, width, 3, padding=1)
        self.along = nn.Conv2d(4 * width, width, 1)
        self.second = nn.Conv2d(width, width, 3, padding=1)

    def forward(self, x: Tensor, count: int) -> Tensor:
        inner = functional.relu(self.around(x)).view(-1, count, *x.shape[1:])
        # The outermost are their own neighbours.
        rise, none = inner.diff(dim=1), torch.zeros_like(inner[:, :1])
        most = inner.amax(1, keepdim=True) - inner
        sides = (torch.cat([none, rise], 1), torch.cat([rise, none], 1))
        seen = torch.cat([inner, *sides, most], 2).flatten(0, 1)
        added: Tensor = self.second(functional.relu(self.along(seen)))
        return functional.relu(x + added)
