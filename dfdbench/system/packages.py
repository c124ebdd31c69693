"""What is installed: versions, extras, plug-ins."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points, version

from dfdbench.errors import InputError, Problem

PACKAGE_VERSION = version("dfdbench")
#: The modules that each extra brings.
EXTRAS = {"nets": ("torch", "safetensors"), "onnx": ("onnxruntime",)}
EXTRAS |= {"cluster": ("distributed",), "s3": ("s3fs",)}


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


def offered_as(group: str) -> dict[str, EntryPoint]:
    """Return what installed packages offer in a group of entry points, by name; none is imported.

    Examples
    --------
    >>> offered_as("dfdbench.nothing")
    {}
    """
    return {point.name: point for point in entry_points(group=group)}
