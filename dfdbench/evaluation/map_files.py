"""Write depth maps that were estimated without a data set: files, or a test server's zip."""

import contextlib
import hashlib
import io
import json
import re
import zipfile
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image

from dfdbench.errors import InputError, reason_of
from dfdbench.evaluation.plan import differences_from
from dfdbench.evaluation.prediction_files import SIXTEEN_BIT
from dfdbench.methods.method import DepthMap, Method
from dfdbench.metrics.protocol import Unit
from dfdbench.results.run_folder import previous_of
from dfdbench.system.files import write_whole
from dfdbench.system.text import parse_json

#: How the file of a depth map may end.
MAPS = (".npy", ".npz", ".png")
# Hidden: `dfdbench score` takes every other file of the folder for a depth map.
_RECORD = ".predicted.json"


def require_map(path: Path) -> None:
    """Do nothing where a file's name is that of a depth map.

    Raises
    ------
    InputError
        If it ends otherwise.
    """
    if path.suffix not in MAPS:
        raise InputError("a depth map is written as .npy, .npz or .png", where=str(path))


def write_depth(
    path: Path, depth: DepthMap, unit: Unit = "levels", sigma: DepthMap | None = None
) -> None:
    """Write a depth map: ``.npy`` as it is, ``.png`` as 16 bit, level times 256 or millimetres.

    Only ``.npz`` has room for sigma too, the standard deviation of each pixel: arrays ``depth`` and
    ``sigma``, as ``dfdbench score`` reads them.

    Raises
    ------
    InputError
        If the file's name ends otherwise, it cannot be written, or it is a PNG file and pixels have
        no answer.
    """
    file = io.BytesIO()
    if path.suffix == ".npy":
        np.save(file, depth)
    elif path.suffix == ".npz":
        arrays: dict[str, Any] = {"depth": depth} | ({} if sigma is None else {"sigma": sigma})
        np.savez_compressed(file, **arrays)
    elif path.suffix == ".png":
        if gaps := np.count_nonzero(np.isnan(depth)):
            what = f"{gaps} of {depth.size} pixels have no answer, which a PNG file cannot say"
            raise InputError(what, where=str(path), fix="name a file that ends in .npy or .npz")
        whole = np.rint(np.minimum(depth * SIXTEEN_BIT[unit], 65535)).astype(np.uint16)
        PIL.Image.fromarray(whole).save(file, "png")
    else:
        require_map(path)
    _write_content(path, file.getvalue(), "depth map")


class KeptMaps:
    """The depth maps of a folder, and what each was made of: a stopped call goes on with the rest.

    Parameters
    ----------
    folder : Path
        Where they lie.
    method : Method
        What makes them.
    identity : mapping
        What has to be the same for maps of an earlier call to be taken over.
    """

    def __init__(self, folder: Path, method: Method, identity: Mapping[str, Any]) -> None:
        self._folder, self._method, self._identity = folder, method, identity
        self._maps: dict[str, dict[str, str]] = {}
        differences: Sequence[str] = ()
        # What cannot be read, or is no record of ours, says nothing of the maps.
        with contextlib.suppress(OSError, ValueError, TypeError, AttributeError, KeyError):
            before = parse_json((folder / _RECORD).read_text("utf-8"))
            self._maps = {
                str(name): {"file": f"{found['file']}", "images": f"{found['images']}"}
                for name, found in before.pop("maps").items()
            }
            differences = differences_from(before, identity, method)
        #: Where the maps of another method, or of other parameters, were moved.
        self.set_aside = self._moved_aside() if differences else None

    def _moved_aside(self) -> Path:
        # A folder such as . has no name to go by.
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
        """Return the files of earlier calls' maps of other captures than these."""
        files = [found["file"] for name, found in self._maps.items() if name not in captures]
        return [file for file in files if (self._folder / file).is_file()]

    def place_of(self, name: str, images: Iterable[Path]) -> Path | None:
        """Return the depth map that an earlier call made of the same images; None without one."""
        found = self._maps.get(name, {})
        place = self._folder / found.get("file", name)
        same = place.is_file() and found.get("images") == _sha256(images)
        return place if same else None

    def add(
        self, name: str, images: Iterable[Path], depth: DepthMap, sigma: DepthMap | None
    ) -> Path:
        """Write a depth map, ``.npz`` with its sigma if there is one, and return where it lies."""
        place = self._folder / f"{name}.{'npy' if sigma is None else 'npz'}"
        write_depth(place, depth, sigma=sigma)
        file = place.relative_to(self._folder).as_posix()
        self._maps[name] = {"file": file, "images": _sha256(images)}
        record = {**self._identity, "used": self._method.used, "maps": self._maps}
        _write_content(self._folder / _RECORD, json.dumps(record).encode(), "record")
        return place


def _sha256(images: Iterable[Path]) -> str:
    """Return the SHA-256 of images, or of all that lies in a stack's folder."""
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
        Each capture's name, which begins with its scene's, as ``test_0001``; its depth in metres,
        float32, shape (y, x).

    Raises
    ------
    InputError
        If a scene has no number, or two captures have the same, or the file cannot be written.
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
                fix = "leave one capture a scene in the folder"
                raise InputError(what, where=name, fix=fix)
            written[file] = name
            with archive.open(file, "w") as entry:
                np.save(entry, depth)
    _write_content(path, content.getvalue(), "depth maps")


def _write_content(path: Path, content: bytes, what: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
    except OSError as error:
        raise InputError(f"cannot write the {what}: {reason_of(error)}", where=str(path)) from error
