"""What runs are called beside each other, and which of those given are meant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from dfdbench.results.folder import PREVIOUS
from dfdbench.results.record_file import RESULT
from dfdbench.results.saved_run import SavedRun


def told_apart(runs: Iterable[SavedRun]) -> list[SavedRun]:
    """Return the runs, each with the folder's name in its label where labels would be the same.

    Where the folders are called the same too, as much of the path is said as tells them apart.
    Runs on other data or another split never stand in one table and need no telling.

    Parameters
    ----------
    runs : iterable of SavedRun
        Each of another file.
    """
    runs = list(runs)
    alike: dict[tuple[str, str, str], list[int]] = {}
    for number, run in enumerate(runs):
        data = run.result.dataset
        alike.setdefault((data.fingerprint, data.split, run.label), []).append(number)
    for numbers in alike.values():
        if len(numbers) > 1:
            places = _shortest([_place(runs[number].path) for number in numbers])
            for number, place in zip(numbers, places, strict=True):
                runs[number] = replace(runs[number], place=place)
    return runs


def without_previous(paths: Sequence[Path]) -> tuple[list[Path], list[tuple[Path, Path]]]:
    """Part off the runs that were set aside for a newer one that is given too.

    A pattern such as ``results/demo-1-test/*`` names both, and means the newer.

    Parameters
    ----------
    paths : sequence of Path
        Result files or runs' folders.

    Returns
    -------
    list of Path
        Those that are left, in their order.
    list of (Path, Path)
        Each one left out, and the newer one of it.
    """
    given = {_folder(path): path for path in paths}
    kept, left_out = [], []
    for path in paths:
        folder = _folder(path)
        newer = given.get(folder.with_name(folder.name.removesuffix(PREVIOUS)))
        if folder.name.endswith(PREVIOUS) and newer is not None:
            left_out.append((path, newer))
        else:
            kept.append(path)
    return kept, left_out


def _folder(path: Path) -> Path:
    return (path.parent if path.name == RESULT else path).absolute()


def _place(file: Path) -> Path:
    file = file.absolute()
    return file.parent if file.name == RESULT else file.with_suffix("")


def _shortest(places: Sequence[Path]) -> list[str]:
    """Return the ends of paths, as long as need be for no two to be the same."""
    longest = max(len(place.parts) for place in places)
    for count in range(1, longest + 1):
        ends = ["/".join(place.parts[-count:]) for place in places]
        if len({*ends}) == len(ends):
            break
    return ends
