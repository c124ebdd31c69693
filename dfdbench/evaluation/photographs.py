"""Read photographs and stacks from files of any folder."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dfdbench.building.export import PAIR_IMAGES, STACK_FILE
from dfdbench.building.sources import image_files
from dfdbench.building.sources.captured_images import in_one
from dfdbench.datasets.captured_files import OF_CAMERA, CapturedFiles
from dfdbench.datasets.captures import ROLES
from dfdbench.errors import DfdbenchError, InputError, Problem, SourceError, reason_of
from dfdbench.system.files import LARGEST_ARRAY, read_text, read_whole
from dfdbench.system.text import parse_json

if TYPE_CHECKING:
    import xarray

_NUMBERS = "near", "far", *OF_CAMERA
Image = NDArray[np.uint8]


def read_images(
    images: Iterable[Image | Path | str], files: CapturedFiles | None = None, deep: bool = False
) -> list[Image]:
    """Read images that are files; return arrays as they are.

    A photograph is RGB, uint8 of shape (y, x, 3), or as `deep` uint16 if the file has it. It is
    upright according to its EXIF data, unless its data set's `files` say otherwise.

    Raises
    ------
    SourceError
        If images are missing, damaged or not photographs; it lists the problems of each.
    """
    found, problems = list[Image](), list[Problem]()
    bits, rotation = (files.image_bits, files.exif_rotation) if files else (None, None)
    how = (bits, rotation or "apply", deep)
    for image in images:
        if not isinstance(image, str | Path):
            found.append(image)
            continue
        path = Path(image)
        try:
            content = read_whole(path, LARGEST_ARRAY)
            found.append(image_files.read_photograph(content, str(path), *how))
        except DfdbenchError as error:
            problems += error.problems
        except OSError as error:
            problems.append(Problem(f"cannot read it: {reason_of(error)}", where=str(path)))
    SourceError.raise_if(problems)
    return found


def read_stack(place: Path) -> xarray.DataArray:
    """Read a stack as `dfdbench.building.export.export` writes it: images and ``stack.json``.

    Raises
    ------
    InputError
        If an image is missing, damaged or of a different size.
    """
    import xarray

    try:
        said = parse_json(read_text(place / STACK_FILE))
        # An exported image is full, however dark.
        files = CapturedFiles(image_bits=16)
        for name in said["images"]:
            if Path(name).name != name:
                raise ValueError(f"{name} is not the name of a file beside it")
        images = read_images((place / name for name in said["images"]), files, deep=True)
        if len({image.shape for image in images}) > 1:
            sizes = ", ".join(dict.fromkeys(size_of(image) for image in images))
            raise InputError("images of a stack differ in size", where=str(place), got=sizes)
        coordinates = {
            name: ("image", np.array(values, None if name == "role" else np.float64))
            for name, values in said["coordinates"].items()
        }
        dimensions = ("image", "y", "x", "channel")
        attributes = {
            name: float("nan" if value is None else value) if name in _NUMBERS else value
            for name, value in said["attributes"].items()
        }
        if PAIR_IMAGES in attributes:
            first, second = said["attributes"][PAIR_IMAGES]
            attributes[PAIR_IMAGES] = [operator.index(first), operator.index(second)]
        return xarray.DataArray(in_one(images), coordinates, dimensions, attrs=attributes)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        what = f"the stack cannot be read: {reason_of(error)}"
        raise InputError(what, where=str(place / STACK_FILE)) from error


def captures_in(folder: Path) -> dict[str, tuple[Path, ...]]:
    """Return the pairs and stacks in a folder, by the names of their own folders.

    Returns
    -------
    dict of str to tuple of Path
        For a pair, the in-focus and the defocus image, ``PAIR/infocus.png`` and
        ``PAIR/defocus.png``; for a stack, its folder, which has a ``stack.json``. What lies in
        `folder` itself has its name.
    """
    return {
        name: (found[STACK_FILE].parent,)
        if STACK_FILE in found
        else tuple(found[role] for role in ROLES)
        for name, found in _images_in(folder).items()
        if STACK_FILE in found or found.keys() >= set(ROLES)
    }


def lone_images(folder: Path) -> list[Problem]:
    """Return a problem for each folder that holds only one image of a pair."""
    return [
        Problem(f"there is no {other} image beside it", where=str(found[role]))
        for found in _images_in(folder).values()
        for role, other in (ROLES, ROLES[::-1])
        if [*found] == [role]
    ]


def _images_in(folder: Path) -> dict[str, dict[str, Path]]:
    there: dict[str, dict[str, Path]] = {}
    for path in sorted(folder.rglob("*")):
        images = path.suffix.lower() in image_files.SUFFIXES and path.stem in ROLES
        if images or path.name == STACK_FILE:
            name = path.parent.relative_to(folder).as_posix()
            there.setdefault(name, {})[path.stem if images else STACK_FILE] = path
    if own := there.pop(".", None):
        name = folder.resolve().name
        there[name if name not in there else f"{name}-itself"] = own
    return there


def size_of(image: Image) -> str:
    """Return an image's shape in words, as 240 x 320 x 3."""
    return " x ".join(map(str, image.shape))
