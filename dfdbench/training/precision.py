"""Which precision a training computes in: what the processor does fast, where it may choose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import torch

from dfdbench.training.configuration import TrainingConfiguration

#: Processors without one of these work bf16 out in steps: a training takes twenty times as long.
_BF16_INSTRUCTIONS = ("amx_bf16", "avx512_bf16")


def precision_for(device: torch.device) -> tuple[Literal["float32", "bf16"], str]:
    """Return the precision that a device computes fast in, and why.

    Parameters
    ----------
    device : torch.device
        Where the network is trained.

    Returns
    -------
    precision : {"float32", "bf16"}
        As `TrainingConfiguration.precision` has it.
    reason : str
        In words, for people.

    Examples
    --------
    >>> precision, reason = precision_for(torch.device("cpu"))
    >>> precision in ("float32", "bf16")
    True
    """
    if device.type == "cuda":
        if torch.cuda.is_bf16_supported(including_emulation=False):
            return "bf16", "this graphics processor has bf16"
        return "float32", "this graphics processor has no bf16"
    if device.type == "cpu":
        # PyTorch before 2.6 cannot be asked; float32 is right everywhere.
        told: Mapping[str, object] = getattr(torch.cpu, "get_capabilities", dict)()
        there = [name for name in _BF16_INSTRUCTIONS if told.get(name)]
        if there:
            return "bf16", f"this processor has {there[0]}"
    return "float32", f"no fast bf16 is known of this {device.type}"


def settled(configuration: TrainingConfiguration, device: torch.device) -> TrainingConfiguration:
    """Return a configuration whose precision is one of a kind: ``auto`` becomes what is fast.

    Parameters
    ----------
    configuration : TrainingConfiguration
        As it was read.
    device : torch.device
        Where the network is trained.

    Examples
    --------
    >>> settled(TrainingConfiguration(precision="auto"), torch.device("meta")).precision
    'float32'
    """
    if configuration.precision != "auto":
        return configuration
    return configuration.model_copy(update={"precision": precision_for(device)[0]})
