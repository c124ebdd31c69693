"""What installed packages offer us: methods, and readers of data sets."""

from __future__ import annotations

from importlib.metadata import EntryPoint, distributions, entry_points

from dfdbench.errors import InputError


def offered_as(group: str) -> dict[str, EntryPoint]:
    """Return what installed packages offer in a group of entry points, by name; none is imported.

    Raises
    ------
    InputError
        Where a package's list of them cannot be read, whichever group it is about; it is named.

    Examples
    --------
    >>> offered_as("dfdbench.nothing")
    {}
    """
    try:
        return {point.name: point for point in entry_points(group=group)}
    except Exception as error:
        raise InputError(
            "what an installed package offers cannot be read",
            where=f"{_unreadable()}: entry_points.txt",
            got=f"{type(error).__name__}: {error}"[:100],
            fix="install that package anew, or remove it",
        ) from error


def _unreadable() -> str:
    for package in distributions():
        try:
            list(package.entry_points)
        except Exception:
            return str(package.metadata["Name"])
    return "a package"
