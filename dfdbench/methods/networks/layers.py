"""What the networks are put together from."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn

# A residual block adds its input to its output: these columns of Table D.2 must be equal.
EQUAL = ((0, 2), (3, 5), (6, 8), (10, 12), (14, 16))
#: Rows and columns of a filter.
Kernel = tuple[int, int]


class SReLU(nn.Module):
    """The S-shaped rectified linear unit, Table C.2: three straight pieces.

    Its thresholds and the slopes beyond them are learnt, four numbers a layer. It starts as the
    thesis's author has it: between -1 and 1 its input, beyond with a slope of 0.1.

    Examples
    --------
    >>> SReLU()(torch.tensor([-2.0, 0.5, 3.0])).tolist()
    [-1.100000023841858, 0.5, 1.2000000476837158]
    """

    def __init__(self) -> None:
        super().__init__()
        #: Lower threshold and slope below it, upper threshold and slope above it.
        self.pieces = nn.Parameter(torch.tensor([-1.0, 0.1, 1.0, 0.1]))

    def forward(self, x: Tensor) -> Tensor:
        """Return the activations."""
        low, below, high, above = self.pieces.unbind()
        inside = torch.minimum(torch.maximum(x, low), high)
        return inside + below * (x - low).clamp(max=0) + above * (x - high).clamp(min=0)


#: What may follow a convolution, by name, in the order of Table C.2.
ACTIVATIONS: dict[str, type[nn.Module]] = {
    "relu": nn.ReLU,
    "prelu": nn.PReLU,
    "sigmoid": nn.Sigmoid,
    "tanh": nn.Tanh,
    "elu": nn.ELU,
    "srelu": SReLU,
}


class Normalize(nn.Module):
    """Six channels of pixels, less their means, over 256."""

    # Kept in the network: weights without their means would be worth nothing.
    means: Tensor

    def __init__(self, channel_means: Sequence[float]) -> None:
        super().__init__()
        means = torch.tensor([float(mean) for mean in channel_means])
        self.register_buffer("means", means.reshape(1, 6, 1, 1))

    def forward(self, pixels: Tensor) -> Tensor:
        """Return the normalized pixels."""
        return (pixels - self.means) / 256


class Convolved(nn.Module):
    """A convolution, batch normalization, which has the bias (Eq. 5.12), an activation.

    Without batch normalization the convolution has the bias.
    """

    def __init__(
        self,
        before: int,
        after: int,
        activation: nn.Module,
        kernel: Kernel = (3, 3),
        normalized: bool = True,
    ) -> None:
        super().__init__()
        self.convolve: nn.Module = same(before, after, kernel, bias=not normalized)
        self.normalize: nn.Module = nn.BatchNorm2d(after) if normalized else nn.Identity()
        self.activate = activation

    def forward(self, x: Tensor) -> Tensor:
        """Return the activations."""
        convolved: Tensor = self.activate(self.normalize(self.convolve(x)))
        return convolved

    def fold(self) -> None:
        """Put the batch normalization, where there is any, into the convolution."""
        if isinstance(self.normalize, nn.BatchNorm2d):
            assert isinstance(self.convolve, nn.Conv2d)
            self.convolve = nn.utils.fuse_conv_bn_eval(self.convolve, self.normalize)
            self.normalize = nn.Identity()


class Residual(nn.Module):
    """A residual block, Fig. 5.4: what it adds to its input."""

    def __init__(
        self,
        channels: int,
        inner: int,
        activation: nn.Module,
        kernels: tuple[Kernel, Kernel] = ((3, 3), (3, 3)),
        normalized: bool = True,
    ) -> None:
        super().__init__()
        self.first = Convolved(channels, inner, activation, kernels[0], normalized)
        self.second = same(inner, channels, kernels[1])

    def forward(self, x: Tensor) -> Tensor:
        """Return the input and what the block adds to it."""
        added: Tensor = x + self.second(self.first(x))
        return added


def same(before: int, after: int, kernel: Kernel, bias: bool = True) -> nn.Conv2d:
    """Return a convolution with odd filters that keeps the image's size."""
    padding = (kernel[0] // 2, kernel[1] // 2)
    return nn.Conv2d(before, after, kernel, padding=padding, bias=bias)


def in_float32(layers: nn.Module, pixels: Tensor) -> Tensor:
    """Return what layers make of pixels in float32, whatever precision is on."""
    # Blur shows in differences of a grey level or less: bf16 would round them away.
    with torch.autocast(pixels.device.type, enabled=False):
        convolved: Tensor = layers(pixels.float())
    return convolved


def halve(before: int, after: int, size: int) -> nn.Module:
    """Return the convolution that halves the resolution."""
    # An even image is halved exactly by any size: (size - 1) // 2 pixels are added on each side.
    return nn.Conv2d(before, after, size, stride=2, padding=(size - 1) // 2)


def double(before: int, after: int, size: int) -> nn.Module:
    """Return the transposed convolution that doubles the resolution."""
    return nn.ConvTranspose2d(
        before, after, size, stride=2, padding=(size - 1) // 2, output_padding=size % 2
    )


def start_as_published(convolution: nn.Conv2d | nn.ConvTranspose2d) -> None:
    """Draw U-Net's first filters as its paper does."""
    # Ronneberger et al., section 3: without batch normalization, the signal keeps its size
    # through the levels only where filters are drawn with a deviation of sqrt(2 / inputs).
    inputs = convolution.in_channels
    if isinstance(convolution, nn.Conv2d):
        inputs *= convolution.kernel_size[0] * convolution.kernel_size[1]
    nn.init.normal_(convolution.weight, std=math.sqrt(2 / inputs))
    assert convolution.bias is not None
    nn.init.zeros_(convolution.bias)


def two_convolutions(before: int, after: int) -> nn.Sequential:
    """Return what U-Net has on each level: two convolutions with ReLU."""
    return nn.Sequential(
        nn.Conv2d(before, after, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(after, after, 3, padding=1),
        nn.ReLU(),
    )
