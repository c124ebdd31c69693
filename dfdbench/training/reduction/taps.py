"""Where the outputs of DfD-Net's layers are taken, and what is kept of them: their products."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dfdbench.errors import InputError, MethodError, Problem

#: The module whose output is tapped, by the thesis's layer that the count is reported for, input
#: to output: of 52, 48, 40, 32, 24, 20, 12 and 8 the activation that follows, of 45, 37, 29, 17 and
#: 5 the residual block's addition, of 42, 34, 27 and 15 the convolution that halves or doubles the
#: resolution; 2 is the activation before the last layer (6.2).
TAPS: Mapping[int, str] = MappingProxyType(
    {
        52: "entry.activate",
        48: "encode_1.first.activate",
        45: "encode_1",
        42: "down_1",
        40: "encode_2.first.activate",
        37: "encode_2",
        34: "down_2",
        32: "bottom.first.activate",
        29: "bottom",
        27: "up_2",
        24: "merge_2.activate",
        20: "decode_2.first.activate",
        17: "decode_2",
        15: "up_1",
        12: "merge_1.activate",
        8: "decode_1.first.activate",
        5: "decode_1",
        2: "activate",
    }
)


@dataclass(frozen=True)
class Tapped:
    """What is kept of a layer's outputs for one image.

    Parameters
    ----------
    gram : ndarray of float64, shape (filter, filter)
        Products of the feature maps with each other, neither centred nor normalised.
    pixels : int
        Rows times columns of a feature map.
    """

    gram: NDArray[np.float64]
    pixels: int


def tapped_modules(network: nn.Module) -> dict[int, nn.Module]:
    """Return the modules to tap, by layer.

    Raises
    ------
    MethodError
        Where the network lacks one; every such layer is named.
    """
    there = dict(network.named_modules())
    problems = [
        Problem(
            "the network has no such layer to tap",
            where=f"layer {layer}",
            expected=f"DfD-Net, with a module {path}",
            got=type(network).__name__,
        )
        for layer, path in TAPS.items()
        if path not in there
    ]
    if problems:
        raise MethodError.of(problems)
    return {layer: there[path] for layer, path in TAPS.items()}


def tap(
    network: nn.Module, infocus: NDArray[np.uint8], defocus: NDArray[np.uint8]
) -> dict[int, Tapped]:
    """Return what each layer's outputs are for a pair, by layer.

    Parameters
    ----------
    network : nn.Module
        In evaluation mode, its batch normalization not folded; on any device.
    infocus, defocus : ndarray of uint8, shape (y, x, 3)
        RGB. Cut at the lower and right edge to the network's multiple, so that no padding counts.

    Raises
    ------
    InputError
        Where a layer's outputs have fewer pixels than there are filters, or hold what is no number.
    MethodError
        Where the network lacks a layer.
    """
    found: dict[int, Tapped] = {}
    multiple = int(network.multiple)  # type: ignore[arg-type]
    rows, columns = (extent // multiple * multiple for extent in infocus.shape[:2])
    both = np.concatenate([infocus, defocus], axis=2)[:rows, :columns].transpose(2, 0, 1)
    device = next(network.parameters()).device
    pixels = torch.from_numpy(np.ascontiguousarray(both))[None].to(device).float()
    if not pixels.numel():
        raise InputError(
            "the images are too small to tap",
            where=f"{infocus.shape[0]} x {infocus.shape[1]} pixels",
            expected=f"at least {multiple} x {multiple}",
        )
    with ExitStack() as hooks, torch.inference_mode():
        for layer, module in tapped_modules(network).items():
            hooks.callback(module.register_forward_hook(_keeping(found, layer)).remove)
        network(pixels)
    # Modules are called in their own order, which need not be that of the layers.
    found = {layer: found[layer] for layer in TAPS}
    _require_usable(found)
    return found


def _keeping(
    found: dict[int, Tapped], layer: int
) -> Callable[[nn.Module, tuple[Tensor, ...], Tensor], None]:
    def keep(module: nn.Module, given: tuple[Tensor, ...], maps: Tensor) -> None:
        vectors = maps[0].flatten(1).cpu().double()
        found[layer] = Tapped((vectors @ vectors.T).numpy(), vectors.shape[1])

    return keep


def _require_usable(found: Mapping[int, Tapped]) -> None:
    problems = []
    for layer, taken in found.items():
        filters = len(taken.gram)
        if taken.pixels < filters:
            problems.append(
                Problem(
                    "the sample has fewer pixels than filters",
                    where=f"layer {layer}",
                    expected=f"at least {filters} pixels in a feature map",
                    got=str(taken.pixels),
                    fix="take larger images",
                )
            )
        elif not np.isfinite(taken.gram).all():
            problems.append(
                Problem(
                    "the layer's outputs are no numbers",
                    where=f"layer {layer}",
                    fix="train the network again, with a lower learning_rate",
                )
            )
    if problems:
        raise InputError.of(problems)
