"""Libraries that only an extra brings: what to install where one is absent."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from dfdbench.errors import InputError, Problem

#: The modules that each extra brings.
EXTRAS = {"nets": ("torch", "safetensors"), "cluster": ("distributed",), "s3": ("s3fs",)}


def extra_of(module: str | None) -> str | None:
    """Return the extra that brings a module, or None.

    Examples
    --------
    >>> extra_of("torch.nn")
    'nets'
    """
    package = (module or "").partition(".")[0]
    return next((extra for extra, names in EXTRAS.items() if package in names), None)


def absent(module: str, extra: str) -> Problem:
    """Return the problem of a library that is not installed."""
    return Problem(f"{module} is not installed", fix=f"pip install 'dfdbench[{extra}]'")


@contextmanager
def needed() -> Iterator[None]:
    """Tell what to install where the block imports a library that is absent.

    Raises
    ------
    InputError
        Naming the extra.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        extra = extra_of(error.name)
        if extra is None:
            raise
        raise InputError.of(absent(str(error.name), extra)) from error
