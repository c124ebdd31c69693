"""A checkpoint's file and tensors, looked at before they are trusted.

Each check raises a `ValueError` that says what it found, for the folder to tell where.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch.nn import Parameter

#: A checkpoint of the thesis's network has 170 MB.
_LARGEST = 2**32
_MOMENTS = ("exp_avg", "exp_avg_sq")


def require_plain_archive(path: Path) -> None:
    """Do nothing where a checkpoint's archive takes no more memory than it has bytes.

    Raises
    ------
    ValueError
        Where it is compressed, as `torch.save` never does, or too large.
    OSError, zipfile.BadZipFile
        Where it cannot be read, or is no archive.
    """
    if path.stat().st_size > _LARGEST:
        raise ValueError(f"it is larger than {_LARGEST / 2**30:g} GB")
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            if member.compress_type != zipfile.ZIP_STORED or member.file_size > _LARGEST:
                raise ValueError(f"{member.filename[:60]} is compressed, or too large")


def counts(state: Mapping[str, Any], name: str, size: int) -> torch.Tensor:
    """Return a tensor of so many whole numbers, 0 or more.

    Raises
    ------
    ValueError
        Where it is none.
    """
    value = state[name]
    if not isinstance(value, torch.Tensor) or value.dtype != torch.int64 or value.shape != (size,):
        raise ValueError(f"{name} is no tensor of {size} whole numbers")
    # A copy: a tensor of a file may show one number many times.
    value = value.clone()
    if bool((value < 0).any()):
        raise ValueError(f"{name} holds a number below 0")
    return value


def moments_of(state: Mapping[str, Any], parameters: Sequence[Parameter]) -> dict[int, Any]:
    """Return what Adam keeps of each parameter, and nothing else of an optimizer's state.

    Parameters
    ----------
    state : mapping
        What `torch.optim.Adam.state_dict` gave.
    parameters : sequence of Parameter
        Of the optimizer, in its order.

    Raises
    ------
    ValueError
        Where a tensor is lacking, or not of its parameter's shape.
    """
    kept = state["state"]
    if not kept.keys() <= set(range(len(parameters))):
        raise ValueError("the optimizer's state is of other parameters")
    found: dict[int, Any] = {}
    for number, own in kept.items():
        shape = parameters[number].shape
        if own.keys() != {"step", *_MOMENTS}:
            raise ValueError("the optimizer's state is not that of Adam")
        for name, expected in (("step", ()), *((moment, shape) for moment in _MOMENTS)):
            value = own[name]
            if not isinstance(value, torch.Tensor) or value.dtype != torch.float32:
                raise ValueError(f"the optimizer's {name} is no tensor of float32")
            if value.shape != expected or not bool(torch.isfinite(value).all()):
                raise ValueError(f"the optimizer's {name} has another shape, or no numbers")
        if bool((own["exp_avg_sq"] < 0).any()) or own["step"] < 0:
            raise ValueError("the optimizer's squares are below 0")
        found[number] = {name: own[name].clone() for name in ("step", *_MOMENTS)}
    return found
