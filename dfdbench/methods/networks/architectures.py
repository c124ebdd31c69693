"""The networks of the thesis as PyTorch modules; needs the extra ``nets``."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import InputError
from dfdbench.methods.networks import choices
from dfdbench.tables.table import listed


class SReLU(nn.Module):
    """The S-shaped rectified linear unit, Table C.2: three straight pieces.

    It learns its thresholds and the slopes beyond them, four numbers per layer. It starts as in the
    thesis author's code: the identity between -1 and 1, and a slope of 0.1 beyond.

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


#: The activations that may follow a convolution, by name, in the order of Table C.2.
ACTIVATIONS: dict[str, type[nn.Module]] = {
    "relu": nn.ReLU,
    "prelu": nn.PReLU,
    "sigmoid": nn.Sigmoid,
    "tanh": nn.Tanh,
    "elu": nn.ELU,
    "srelu": SReLU,
}


class Normalize(nn.Module):
    """Six channels of pixels, minus their means, divided by 256."""

    # Kept in the network, since weights are useless without their means.
    means: Tensor

    def __init__(self, channel_means: Sequence[float]) -> None:
        super().__init__()
        means = torch.tensor([float(mean) for mean in channel_means])
        self.register_buffer("means", means.reshape(1, 6, 1, 1))

    def forward(self, pixels: Tensor) -> Tensor:
        """Return the normalized pixels."""
        return (pixels - self.means) / 256


class Convolved(nn.Module):
    """A convolution, batch normalization, which includes the bias (Eq. 5.12), and an activation.

    Without batch normalization, the convolution has the bias.
    """

    def __init__(
        self,
        before: int,
        after: int,
        activation: nn.Module,
        kernel: choices.Kernel = (3, 3),
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
        """Fold the batch normalization, if there is any, into the convolution."""
        if isinstance(self.normalize, nn.BatchNorm2d):
            assert isinstance(self.convolve, nn.Conv2d)
            self.convolve = nn.utils.fuse_conv_bn_eval(self.convolve, self.normalize)
            self.normalize = nn.Identity()


class Residual(nn.Module):
    """A residual block, Fig. 5.4, which adds the output of its layers to its input."""

    def __init__(
        self,
        channels: int,
        inner: int,
        activation: nn.Module,
        kernels: tuple[choices.Kernel, choices.Kernel] = ((3, 3), (3, 3)),
        normalized: bool = True,
    ) -> None:
        super().__init__()
        self.first = Convolved(channels, inner, activation, kernels[0], normalized)
        self.second = same(inner, channels, kernels[1])

    def forward(self, x: Tensor) -> Tensor:
        """Return the sum of the input and the layers' output."""
        added: Tensor = x + self.second(self.first(x))
        return added


def same(before: int, after: int, kernel: choices.Kernel, bias: bool = True) -> nn.Conv2d:
    """Return a convolution with odd filters that keeps the image's size."""
    padding = (kernel[0] // 2, kernel[1] // 2)
    return nn.Conv2d(before, after, kernel, padding=padding, bias=bias)


def in_float32(layers: Callable[[Tensor], Tensor], pixels: Tensor) -> Tensor:
    """Apply layers to pixels in float32, whatever precision is on."""
    # Blur shows in differences of a grey level or less, which bf16 would round away.
    with torch.autocast(pixels.device.type, enabled=False):
        convolved: Tensor = layers(pixels.float())
    return convolved


def halve(before: int, after: int, size: int) -> nn.Module:
    """Return the convolution that halves the resolution."""
    # Any size halves an even image exactly, with (size - 1) // 2 pixels of padding on each side.
    return nn.Conv2d(before, after, size, stride=2, padding=(size - 1) // 2)


def double(before: int, after: int, size: int) -> nn.Module:
    """Return the transposed convolution that doubles the resolution."""
    return nn.ConvTranspose2d(
        before, after, size, stride=2, padding=(size - 1) // 2, output_padding=size % 2
    )


def start_as_published(convolution: nn.Conv2d | nn.ConvTranspose2d) -> None:
    """Draw U-Net's first filters as its paper does."""
    # Ronneberger et al., section 3: without batch normalization, the signal keeps its size
    # through the levels only if filters are drawn with a deviation of sqrt(2 / inputs).
    inputs = convolution.in_channels
    if isinstance(convolution, nn.Conv2d):
        inputs *= convolution.kernel_size[0] * convolution.kernel_size[1]
    nn.init.normal_(convolution.weight, std=math.sqrt(2 / inputs))
    assert convolution.bias is not None
    nn.init.zeros_(convolution.bias)


def two_convolutions(before: int, after: int, normalized: bool) -> nn.Sequential:
    """Return a level of U-Net: two convolutions with ReLU."""
    layers: list[nn.Module] = []
    for channels in (before, after):
        layers.append(nn.Conv2d(channels, after, 3, padding=1))
        layers += [nn.BatchNorm2d(after)] * normalized + [nn.ReLU()]
    return nn.Sequential(*layers)


@torch.no_grad()
def start_from_differences(network: DfDNet | UNet, pixels: Tensor) -> None:
    """Make an untrained network look for blur rather than for brightness.

    One half of the first filters takes the difference of the two images, the other half the
    in-focus image's detail, so they do not see brightness. Both signals are small compared with
    brightness. So each filter is scaled to a deviation of one (Mishkin and Matas 2016), as a
    network without batch normalization would otherwise hardly notice them. This is not from the
    thesis.

    Parameters
    ----------
    network : DfDNet or UNet
        Its first convolution is changed in place.
    pixels : Tensor
        Images like those it will be trained on, shape (n, 6, y, x).
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
    """Fold batch normalization into the convolutions before it, in place; for inference only.

    Parameters
    ----------
    network : nn.Module
        A network in evaluation mode.

    Examples
    --------
    >>> from dfdbench.methods.networks.choices import FILTERS
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


#: One class a depth level.
#: Means of the published training images: in-focus R, G, B, then defocus R, G, B.
PUBLISHED_MEANS = (110.9551, 98.1071, 69.9262, 111.0131, 98.1506, 69.9516)
#: Channels of the U-Net's levels, Ronneberger et al. 2015.
UNET_FILTERS = (64, 128, 256, 512, 1024)


class DfDNet(nn.Module):
    """DfD-Net, the thesis's network: 18 convolutions on three levels, Fig. 5.5.

    It takes pixels, float (n, 6, y, x), values 0 to 255, in-focus RGB then defocus RGB, and returns
    logits, float (n, 256, y, x), one for each depth level. `y` and `x` must be multiples of 4.

    Parameters
    ----------
    filters : sequence of 18 int
        The number of filters of each convolution, input to output; `FILTERS` has those of
        Table D.2 by name, and ``pso``.
    sampling_size : int
        Rows and columns of the filters that halve and double the resolution (5.4.5).
    first_activation : str
        The activation after the first convolution: ``"prelu"``, or ``"sigmoid"`` as the particle
        swarm chose (6.1). The filters it chose are very likely ``FILTERS["pso"]``.
    channel_means : sequence of 6 float
        Subtracted from the pixels before they are divided by 256.
    kernels : sequence of 14 int or pairs of int, optional
        Rows and columns of the filters that keep the resolution, odd, 1 to 9, input to output:
        `dfdbench.methods.networks.choices.SIZED` has the thesis's layers. By default 3.
    activations : sequence of 9 str, optional
        The activations at the nine sites of `dfdbench.methods.networks.choices.SITES`, input to
        output: ``relu``, ``prelu``, ``sigmoid``, ``tanh``, ``elu`` or ``srelu`` (Table C.2). By
        default `first_activation` at the first site, and PReLU at the others.
    normalized : sequence of 9 bool, optional
        Whether there is batch normalization at each of these sites; by default at all of them.

    Raises
    ------
    InputError
        If the numbers of filters do not match; it names the thesis's layers.

    Examples
    --------
    >>> from dfdbench.methods.networks.choices import FILTERS
    >>> network = DfDNet(FILTERS["F-02-02"])
    >>> network(torch.zeros(1, 6, 8, 12)).shape
    torch.Size([1, 256, 8, 12])
    """

    multiple = 4
    """Images are padded to a multiple of this."""

    def __init__(
        self,
        filters: Sequence[int] = choices.FILTERS["original"],
        sampling_size: int = 2,
        first_activation: str = "prelu",
        channel_means: Sequence[float] = PUBLISHED_MEANS,
        kernels: Sequence[int | Sequence[int]] | None = None,
        activations: Sequence[str] | None = None,
        normalized: Sequence[bool] | None = None,
    ) -> None:
        super().__init__()
        f = choices.checked_filters(filters)
        k = choices.kernel_sizes(kernels)
        a = [
            ACTIVATIONS[name]() for name in choices.activation_names(activations, first_activation)
        ]
        n = [True] * len(a) if normalized is None else normalized
        #: Pixels beyond this distance do not affect a pixel's answer.
        self.margin = choices.reach_of(k, sampling_size)
        self.pixels = Normalize(channel_means)
        self.entry = Convolved(6, f[0], a[0], k[52], n[0])
        self.encode_1 = Residual(f[0], f[1], a[1], (k[48], k[45]), n[1])
        self.down_1 = halve(f[2], f[3], sampling_size)
        self.encode_2 = Residual(f[3], f[4], a[2], (k[40], k[37]), n[2])
        self.down_2 = halve(f[5], f[6], sampling_size)
        self.bottom = Residual(f[6], f[7], a[3], (k[32], k[29]), n[3])
        self.up_2 = double(f[8], f[9], sampling_size)
        self.merge_2 = Convolved(f[9] + f[5], f[10], a[4], k[24], n[4])
        self.decode_2 = Residual(f[10], f[11], a[5], (k[20], k[17]), n[5])
        self.up_1 = double(f[12], f[13], sampling_size)
        self.merge_1 = Convolved(f[13] + f[2], f[14], a[6], k[12], n[6])
        self.decode_1 = Residual(f[14], f[15], a[7], (k[8], k[5]), n[7])
        self.normalize: nn.Module = nn.BatchNorm2d(f[16]) if n[8] else nn.Identity()
        self.activate = a[8]
        self.classify = same(f[16], f[17], k[1])

    @property
    def first(self) -> nn.Module:
        """The convolution that takes the images."""
        return self.entry.convolve

    def forward(self, pixels: Tensor) -> Tensor:
        """Return logits of the depth levels."""
        logits: Tensor = self.classify(self.hidden(pixels))
        return logits

    def hidden(self, pixels: Tensor) -> Tensor:
        """Return what the last convolution takes."""
        level_1: Tensor = self.encode_1(in_float32(self.entry, self.pixels(pixels)))
        level_2: Tensor = self.encode_2(self.down_1(level_1))
        up_2: Tensor = self.up_2(self.bottom(self.down_2(level_2)))
        level_2 = self.decode_2(self.merge_2(torch.cat((up_2, level_2), 1)))
        level_1 = self.decode_1(self.merge_1(torch.cat((self.up_1(level_2), level_1), 1)))
        activated: Tensor = self.activate(self.normalize(level_1))
        return activated


class UNet(nn.Module):
    """U-Net with six input channels and 256 output classes: the thesis's comparison (5.3).

    It has five levels of two convolutions with ReLU, max pooling and transposed 2 x 2 convolutions
    (Ronneberger et al. 2015). Its convolutions are padded so that the answer has the image's size;
    the original's shrink it. It is called like `DfDNet`; `y` and `x` must be multiples of 16.

    Parameters
    ----------
    filters : sequence of 5 int
        Channels of the levels; all but the first must be even.
    channel_means : sequence of 6 float
        Subtracted from the pixels before they are divided by 256.
    normalized : bool
        Whether batch normalization follows each 3 x 3 convolution; the original has none.

    Raises
    ------
    InputError
        If `filters` are not five positive numbers, all but the first even.

    Examples
    --------
    >>> UNet(filters=(4, 8, 16, 32, 64))(torch.zeros(1, 6, 16, 32)).shape
    torch.Size([1, 256, 16, 32])
    """

    multiple = 16
    """Images are padded to a multiple of this."""
    margin = 112
    """Pixels beyond this distance do not change a pixel's answer."""

    def __init__(
        self,
        filters: Sequence[int] = UNET_FILTERS,
        channel_means: Sequence[float] = PUBLISHED_MEANS,
        normalized: bool = False,
    ) -> None:
        super().__init__()
        f = [int(number) for number in filters]
        if len(f) != len(UNET_FILTERS) or min(f) < 1 or any(number % 2 for number in f[1:]):
            what = f"filters do not fit U-Net, which has 5, the last four even: {listed(f)}"
            raise InputError(what, where="filters")
        self.pixels = Normalize(channel_means)
        self.encoders = nn.ModuleList(
            two_convolutions(before, after, normalized)
            for before, after in zip([6, *f[:-1]], f, strict=True)
        )
        self.ups = nn.ModuleList(
            nn.ConvTranspose2d(number, number // 2, 2, stride=2) for number in f[:0:-1]
        )
        self.decoders = nn.ModuleList(
            two_convolutions(below // 2 + here, here, normalized)
            for below, here in zip(f[:0:-1], f[-2::-1], strict=True)
        )
        self.classify = nn.Conv2d(f[0], LEVELS, 1)
        for module in self.modules():
            if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
                start_as_published(module)

    @property
    def first(self) -> nn.Module:
        """The convolution that takes the images."""
        first: nn.Module = self.encoders[0][0]  # type: ignore[index]
        return first

    def forward(self, pixels: Tensor) -> Tensor:
        """Return logits of the depth levels."""
        logits: Tensor = self.classify(self.hidden(pixels))
        return logits

    def hidden(self, pixels: Tensor) -> Tensor:
        """Return what the last convolution takes."""
        here = in_float32(self.encoders[0], self.pixels(pixels))
        skipped = []
        for encode in self.encoders[1:]:
            skipped.append(here)
            here = encode(nn.functional.max_pool2d(here, 2))
        for up, decode in zip(self.ups, self.decoders, strict=True):
            here = decode(torch.cat((up(here), skipped.pop()), 1))
        return here
