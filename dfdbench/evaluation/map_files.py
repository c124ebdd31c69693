"""Depth maps in files: write estimated ones, and find and check those made elsewhere."""

import contextlib
import hashlib
import io
import json
import re
import zipfile
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import ALL_PAIRS, Depth, Pair
from dfdbench.errors import InputError, Problem, ResultError, reason_of
from dfdbench.evaluation.plan import differences_from
from dfdbench.methods.calling import check_answer
from dfdbench.methods.method import DepthMap, Method
from dfdbench.metrics.protocol import Unit
from dfdbench.results.run_folder import previous_of
from dfdbench.system.array_files import UNREADABLE_IMAGE, load_array, load_arrays
from dfdbench.system.files import read_text, write_whole
from dfdbench.system.text import parse_json
from dfdbench.tables.table import listed

#: The suffixes of depth map files.
MAPS = (".npy", ".npz", ".png")
# Hidden, because `dfdbench score` takes every other file of the folder for a depth map.
_RECORD = ".predicted.json"
_MOST_16, _TOO_FAR = 65535, "are farther than 65.535 m"


def require_map(path: Path) -> None:
    """Raise if a file's name does not have the suffix of a depth map.

    Raises
    ------
    InputError
        If it has another suffix.
    """
    if path.suffix not in MAPS:
        raise InputError("a depth map is written as .npy, .npz or .png", where=str(path))


def write_depth(
    path: Path, depth: DepthMap, unit: Unit = "levels", sigma: DepthMap | None = None
) -> None:
    """Write a depth map: ``.npy`` as it is, ``.png`` as 16 bit, level times 256 or millimetres.

    Only ``.npz`` can also hold sigma, the standard deviation of each pixel: arrays ``depth`` and
    ``sigma``, as ``dfdbench score`` reads them.

    Raises
    ------
    InputError
        If the file has another suffix or cannot be written, or if it is a PNG file and pixels have
        no answer or are farther than 65.535 m.
    """
    require_map(path)
    file = io.BytesIO()
    if path.suffix == ".npy":
        np.save(file, depth)
    elif path.suffix == ".npz":
        arrays: dict[str, Any] = {"depth": depth} | ({} if sigma is None else {"sigma": sigma})
        np.savez_compressed(file, **arrays)
    else:
        whole = np.rint(depth * SIXTEEN_BIT[unit])
        for wrong, said in ((np.isnan(whole), "have no answer"), (whole > _MOST_16, _TOO_FAR)):
            if count := np.count_nonzero(wrong):
                what = f"{count} of {depth.size} pixels {said}, which a PNG file cannot say"
                raise InputError(what, where=str(path), fix="name a file that ends in .npy or .npz")
        Image.fromarray(whole.astype(np.uint16)).save(file, "png")
    _write_content(path, file.getvalue(), "depth map")


class KeptMaps:
    """The depth maps in a folder and what each was made from, so that a stopped call can resume.

    Parameters
    ----------
    folder : Path
        Where they are.
    method : Method
        The method that makes them.
    identity : mapping
        What has to be the same to reuse an earlier call's maps.
    """

    def __init__(self, folder: Path, method: Method, identity: Mapping[str, Any]) -> None:
        self._folder, self._method, self._identity = folder, method, identity
        self._maps: dict[str, dict[str, str]] = {}
        differences: Sequence[str] = ()
        # Ignore a record that cannot be read or is not ours.
        with contextlib.suppress(OSError, ValueError, TypeError, AttributeError, KeyError):
            before = parse_json(read_text(folder / _RECORD))
            self._maps = {
                str(name): {key: f"{found[key]}" for key in ("file", "images", "map")}
                for name, found in before.pop("maps").items()
            }
            differences = differences_from(before, identity, method)
        #: Where the maps of another method or other parameters were moved.
        self.set_aside = self._moved_aside() if differences else None

    def _moved_aside(self) -> Path:
        # A folder such as . has no name of its own.
        folder = self._folder if self._folder.name.strip(".") else self._folder.resolve()
        aside = previous_of(folder)
        files = [_RECORD, *(found["file"] for found in self._maps.values())]
        self._maps = {}
        try:
            for file in files:
                place = (folder / file).resolve()
                if place.is_file() and place.is_relative_to(folder.resolve()):
                    (aside / file).parent.mkdir(parents=True, exist_ok=True)
                    place.replace(aside / file)
        except OSError as error:
            what = f"the maps of an earlier call cannot be moved: {reason_of(error)}"
            raise InputError(what, where=str(aside), fix="choose another folder: --out") from error
        return aside

    def left(self, captures: Collection[str]) -> list[str]:
        """Return the files of earlier calls' maps that are not of these captures."""
        files = [found["file"] for name, found in self._maps.items() if name not in captures]
        return [file for file in files if (self._folder / file).is_file()]

    def place_of(self, name: str, images: Iterable[Path]) -> Path | None:
        """Return the depth map that an earlier call made from the same images, or None."""
        found = self._maps.get(name, {})
        place = self._folder / found.get("file", name)
        same = place.is_file() and found.get("images") == _sha256(images)
        return place if same and found["map"] == _sha256([place]) else None

    def add(
        self, name: str, images: Iterable[Path], depth: DepthMap, sigma: DepthMap | None
    ) -> Path:
        """Write a depth map, as ``.npz`` if it has a sigma, and return its path."""
        place = self._folder / f"{name}.{'npy' if sigma is None else 'npz'}"
        write_depth(place, depth, sigma=sigma)
        file = place.relative_to(self._folder).as_posix()
        self._maps[name] = {"file": file, "images": _sha256(images), "map": _sha256([place])}
        record = {**self._identity, "used": self._method.used, "maps": self._maps}
        _write_content(self._folder / _RECORD, json.dumps(record).encode(), "record")
        return place


def _sha256(images: Iterable[Path]) -> str:
    """Return the SHA-256 of images, or of everything in a stack's folder."""
    hashed = hashlib.sha256()
    for place in images:
        for path in sorted(place.iterdir()) if place.is_dir() else [place]:
            if path.is_file():
                content = path.read_bytes()
                hashed.update(f"{path.name} {len(content)} ".encode() + content)
    return hashed.hexdigest()


def write_submission(path: Path, depths: Iterable[tuple[str, DepthMap]]) -> None:
    """Write depth maps as ZEDD's test server takes them: a zip of ``zedd_output_0001.npy`` ...

    Parameters
    ----------
    path : Path
        The zip.
    depths : iterable of (str, ndarray)
        Each capture's name, which begins with its scene's, such as ``test_0001``; and its depth in
        metres, float32, shape (y, x).

    Raises
    ------
    InputError
        If a scene has no number, two captures have the same one, or the file cannot be written.
    """
    content, written = io.BytesIO(), dict[str, str]()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, depth in depths:
            number = re.search(r"\d+$", name.split("/")[0])
            if number is None:
                what = "a scene without a number, such as test_0001, has no place in the zip"
                raise InputError(what, where=name)
            file = f"zedd_output_{number[0]}.npy"
            if file in written:
                what = f"{written[file]} would be {file}, too"
                fix = "leave one capture of each scene and number in the folder"
                raise InputError(what, where=name, fix=fix)
            written[file] = name
            with archive.open(file, "w") as entry:
                np.save(entry, depth)
    _write_content(path, content.getvalue(), "depth maps")


def _write_content(path: Path, content: bytes, what: str) -> None:
    try:
        write_whole(path, content)
    except OSError as error:
        raise InputError(f"cannot write the {what}: {reason_of(error)}", where=str(path)) from error


#: The suffixes of the formats that are read.
SUFFIXES = (".npy", ".npz", ".png", ".tif", ".tiff")
#: The factor in 16-bit images, by unit: how many grey levels to a depth level or a metre.
SIXTEEN_BIT = {"levels": 256.0, "metres": 1000.0}
_RULE = {"levels": "levels times 256", "metres": "millimetres"}
_NAMED = 10
# The most problems of single files to name: a wrong unit is wrong in all of them.
_MOST = 20


@dataclass(frozen=True)
class PredictionFiles:
    """The depth maps of all captures of a split, found and checked.

    Parameters
    ----------
    files : mapping of Pair to Path
        The file of each pair.
    unit : {"levels", "metres"}
        The unit of the files.
    about : Depth
        What the data set's depth means.
    others : int
        How many files in the folder are of other pairs of the data set.
    """

    files: Mapping[Pair, Path]
    unit: Unit
    about: Depth
    others: int = 0

    def read(self, pair: Pair, shape: tuple[int, int]) -> tuple[DepthMap, DepthMap | None, float]:
        """Return a pair's depth map and its sigma, if any, in the data set's unit, shape (y, x).

        The share of pixels that are beyond the set's ends, and count as the end, comes last.
        """
        return _answer(self.files[pair], shape, self.unit, self.about)


def find_predictions(folder: Path, store: Dataset, split: str, unit: Unit) -> PredictionFiles:
    """Find the depth maps of a split in a folder, and check every one.

    A file is named after its pair, as ``dfdbench info NAME --pairs SPLIT`` lists them, in folders
    or with ``_`` for ``/``: ``Art/view1.npy`` or ``Art_view1.npy``.

    Parameters
    ----------
    folder : Path
        Where they are. Hidden files are ignored.
    store : Dataset
        The data set.
    split : str
        Which pairs.
    unit : {"levels", "metres"}
        Their unit. Arrays (npy, npz) and TIFF files of floats hold the unit itself; 8-bit images
        hold levels; 16-bit images hold levels times 256 or millimetres. From an npz file the array
        ``depth`` is read, and ``sigma``, the standard deviation of each pixel, if there is one.

    Raises
    ------
    ResultError
        If a pair has no file or two, a file belongs to no pair, or a file cannot be read, differs
        in shape from the pair's images, or holds invalid depth. It lists every problem.
    """
    about = store.manifest.depth
    problems = _unfit(folder, store, split, unit)
    ResultError.raise_if(problems)
    wanted = store.pairs(split)
    files, problems = _sorted_out(folder, store, wanted, split)
    wrong: list[Problem] = []
    for pair in (pair for pair in wanted if pair in files):
        shape = store.shape_of(pair.scene)
        try:
            _answer(files[pair], shape, unit, about)
        except ValueError as error:
            expected = f"{shape[0]} x {shape[1]} {unit}; 16-bit images: {_RULE[unit]}"
            wrong.append(Problem(str(error), where=str(files[pair]), expected=expected))
    problems += wrong[:_MOST]
    if wrong[_MOST:]:
        problems.append(Problem(f"more files that cannot be scored: {len(wrong) - _MOST}"))
    ResultError.raise_if(problems)
    chosen = {pair: files[pair] for pair in wanted}
    return PredictionFiles(chosen, unit, about, len(files) - len(chosen))


def _unfit(folder: Path, store: Dataset, split: str, unit: Unit) -> list[Problem]:
    problems = []
    if not folder.is_dir():
        problems.append(Problem("no folder of depth maps", where=str(folder)))
    if not store.pairs(split):
        problems.append(Problem(f"the store holds no pair of split {split}", where=str(store.path)))
    if unit == "metres" and store.manifest.depth.scale is None:
        what = "no depth.scale in the manifest makes metres of levels"
        fix = "hand in depth levels: --unit levels"
        problems.append(Problem(what, where=store.manifest.stem, fix=fix))
    return problems


def _sorted_out(
    folder: Path, store: Dataset, wanted: Sequence[Pair], split: str
) -> tuple[dict[Pair, Path], list[Problem]]:
    named = {}
    for pair in store.manifest.pairs(ALL_PAIRS):
        named[pair.id] = named[pair.id.replace("/", "_")] = pair
    files: dict[Pair, Path] = {}
    surplus, twice = [], []
    for path in sorted(folder.rglob("*")):
        place = path.relative_to(folder)
        if any(part.startswith(".") for part in place.parts) or not path.is_file():
            continue
        found = named.get(place.as_posix().removesuffix(path.suffix))
        if found is None or path.suffix.lower() not in SUFFIXES:
            surplus.append(place.as_posix())
        elif found in files:
            twice.append(f"{files[found].relative_to(folder).as_posix()} and {place.as_posix()}")
        else:
            files[found] = path
    missing = [pair.id for pair in wanted if pair not in files]
    each = f"a file for each of the {len(wanted)} pairs, as {wanted[0].id}.npy"
    ends = f"names of pairs that end in {', '.join(SUFFIXES)}"
    lists = (
        ("pairs without a depth map", missing, each),
        ("pairs with two depth maps", twice, "one file per pair"),
        ("files that are no pair's depth map", surplus, ends),
    )
    about = {
        "where": str(folder),
        "fix": f"dfdbench info {store.manifest.short} --pairs {split} lists the pairs",
    }
    problems = [
        Problem(f"{what}: {len(names)}, {listed(names, _NAMED)}", expected=wish, **about)
        for what, names, wish in lists
        if names
    ]
    return files, problems


def _answer(
    path: Path, shape: tuple[int, int], unit: Unit, about: Depth
) -> tuple[DepthMap, DepthMap | None, float]:
    """Return a file's depth and sigma in the set's unit, and the share beyond the set's ends.

    A ValueError says what is wrong with the file.
    """
    try:
        values, spread = _read(path, unit)
    except UNREADABLE_IMAGE as error:
        # NumPy takes anything but an array for a pickle, and explains how to run that.
        reason = "no array of numbers" if "pickle" in str(error) else reason_of(error)
        raise ValueError(f"cannot be read: {reason}") from error
    if unit == "metres" and values.shape == shape and values.dtype.kind in "uif":
        bad = np.count_nonzero(np.isinf(values) | (values <= 0))
        if bad:
            raise ValueError(f"holds no distance in {bad} of {values.size} pixels")
    try:
        depth, sigma = check_answer(values if spread is None else (values, spread), shape, unit)
    except ValueError as error:
        raise ValueError(str(error).replace("returned", "holds", 1)) from error
    return *about.answer_of_unit(depth, sigma, unit), about.beyond(depth, unit)


def _read(path: Path, unit: Unit) -> tuple[NDArray[Any], NDArray[Any] | None]:
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return np.asarray(load_array(path)), None
    if suffix == ".npz":
        with load_arrays(path) as arrays:
            if len(arrays.files) != 1 and "depth" not in arrays:
                raise ValueError(f"{len(arrays.files)} arrays, none of them called depth")
            depth = np.asarray(arrays["depth" if "depth" in arrays else arrays.files[0]])
            return depth, np.asarray(arrays["sigma"]) if "sigma" in arrays else None
    with Image.open(path) as image:
        image.load()
        # A PNG file has at most 16 bits, which older versions of Pillow widen to 32.
        mode = "I;16" if (image.format, image.mode) == ("PNG", "I") else image.mode
        values = np.asarray(image)
    if mode == "F" or (mode == "L" and unit == "levels"):
        return values, None
    if mode.startswith("I;16"):
        return values / SIXTEEN_BIT[unit], None
    kind = "8 bits hold no metres" if mode == "L" else f"an image of kind {mode}"
    raise ValueError(f"{kind}; a depth map is grey, of 8 bits (levels) or 16, or a TIFF of floats")
