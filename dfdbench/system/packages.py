"""Installed packages: versions, extras, plug-ins."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points, version

from dfdbench.errors import InputError, Problem

PACKAGE_VERSION = version("dfdbench")
#: The modules that each extra installs.
EXTRAS = {"nets": ("torch", "safetensors"), "onnx": ("onnxruntime",)}
EXTRAS |= {"cluster": ("distributed",), "s3": ("s3fs",)}


def extra_of(module: str | None) -> str | None:
    """Return the extra that installs a module, or None.

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
    """Say what to install if the block imports a missing library.

    Raises
    ------
    InputError
        With the extra's name.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        extra = extra_of(error.name)
        if extra is None:
            raise
        raise InputError.of(absent(str(error.name), extra)) from error


def offered_as(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of installed packages in a group, by name, without importing any.

    Examples
    --------
    >>> offered_as("dfdbench.nothing")
    {}
    """
    return {point.name: point for point in entry_points(group=group)}
