"""Read the Middlebury 2005 and 2006 scenes from a folder in the site's layout."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import Problem, SourceError
from dfdbench.manifest import Manifest, Pair
from dfdbench.sources.interface import SceneImages

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


class MiddleburyFolder:
    """Middlebury scenes on disk: ``SCENE/Illum1/Exp0/view1.png``, ``SCENE/disp1.png``.

    Parameters
    ----------
    manifest : Manifest
        The Middlebury manifest.
    folder : Path
        The folder that holds the scenes, or one above it: ``ThirdSize``, ``scenes2005``, or
        their parent.
    default_lighting : bool
        Take ``SCENE/view1.png``, the site's default lighting, for the lighting that the manifest
        names, where the file of that lighting itself is absent.

    Raises
    ------
    SourceError
        Where the folder holds no scene of the manifest.
    """

    def __init__(self, manifest: Manifest, folder: Path, default_lighting: bool = False) -> None:
        self._manifest = manifest
        self._folder = folder
        self._default_lighting = default_lighting
        self._scenes = {
            scene.name: place
            for scene in manifest.scenes
            if (place := self._find_scene(scene.name, scene.source))
        }
        if not self._scenes:
            raise SourceError(
                Problem(
                    "no scene found", str(folder),
                    expected="folders such as Aloe or scenes2005/ThirdSize/Art",
                    got="none" if folder.is_dir() else "no such folder",
                )
            )  # fmt: skip

    @property
    def options(self) -> Mapping[str, Any]:
        """Which lighting the site's default images stand for, if they were asked for."""
        lighting = self._manifest.default_lighting if self._default_lighting else None
        return {"default_lighting_as": lighting}

    def available_pairs(self) -> tuple[Pair, ...]:
        """Return the pairs whose image and depth map are there."""
        return tuple(
            pair
            for pair in self._manifest.pairs()
            if self._image_path(pair) and self._depth_path(pair.scene, pair.at["view"]).exists()
        )

    def signature(self, scene: str) -> str:
        """Return the SHA-256 over the scene's files that a build reads."""
        digest = hashlib.sha256()
        for path in self._files(scene):
            digest.update(path.relative_to(self._scenes[scene]).as_posix().encode())
            digest.update(hashlib.sha256(_read_bytes(path)).digest())
        return digest.hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Read one scene; every file that is damaged or does not fit is told at once."""
        problems: list[Problem] = []
        axes = self._manifest.axes
        depths = {}
        for view in axes["view"]:
            path = self._depth_path(scene, view)
            if path.exists():
                depths[view] = self._decode(path, cv2.IMREAD_GRAYSCALE, problems)
        images: dict[Pair, NDArray[np.uint8]] = {}
        for pair in self._manifest.pairs_of_scene(scene):
            image_path = self._image_path(pair)
            if image_path and pair.at["view"] in depths:
                image = self._decode(image_path, cv2.IMREAD_COLOR_RGB, problems)
                if image is not None:
                    images[pair] = image
        read = {view: depth for view, depth in depths.items() if depth is not None}
        shape = next(iter(read.values())).shape if read else (0, 0)
        problems += [
            Problem("size differs", str(self._image_path(pair)), f"{shape}", f"{image.shape[:2]}")
            for pair, image in images.items()
            if read and image.shape[:2] != shape
        ]
        problems += [
            Problem("size differs", str(self._depth_path(scene, view)), f"{shape}", f"{got.shape}")
            for view, got in read.items()
            if got.shape != shape
        ]
        if problems:
            raise SourceError(problems)
        return self._assemble(read, images, shape)

    def missing_help(self, missing: tuple[Pair, ...]) -> str:
        """Return where the files that are missing can be had, and what they are called."""
        urls = {source.name: source.url for source in self._manifest.sources}
        source_of = {scene.name: scene.source for scene in self._manifest.scenes}
        first = missing[0]
        address = f"{urls[source_of[first.scene]]}/{first.scene}/{_relative_path(first)}"
        lighting = self._manifest.default_lighting or {}
        default = any(
            not self._default_lighting
            and self._scenes.get(pair.scene)
            and all(pair.at[axis] == value for axis, value in lighting.items())
            and (self._scenes[pair.scene] / f"view{pair.at['view']}.png").exists()
            for pair in missing
        )
        hint = "; --default-lighting takes the view1.png beside them for Illum1/Exp2"
        return (
            f"fetch them into the same layout, the first from {address}"
            f"{hint if default else ''}; --allow-missing accepts what is there"
        )

    def _find_scene(self, name: str, source: str) -> Path | None:
        candidates = (
            self._folder / name,
            self._folder / "ThirdSize" / name,
            self._folder / source / "ThirdSize" / name,
        )
        return next((place for place in candidates if place.is_dir()), None)

    def _image_path(self, pair: Pair) -> Path | None:
        if pair.scene not in self._scenes:
            return None
        place = self._scenes[pair.scene]
        path = place / _relative_path(pair)
        if path.exists():
            return path
        lighting = self._manifest.default_lighting or {}
        if self._default_lighting and all(pair.at[axis] == lighting[axis] for axis in lighting):
            default = place / f"view{pair.at['view']}.png"
            return default if default.exists() else None
        return None

    def _depth_path(self, scene: str, view: int) -> Path:
        return self._scenes[scene] / f"disp{view}.png"

    def _files(self, scene: str) -> list[Path]:
        depths = [self._depth_path(scene, view) for view in self._manifest.axes["view"]]
        images = [self._image_path(pair) for pair in self._manifest.pairs_of_scene(scene)]
        return [path for path in depths if path.exists()] + [path for path in images if path]

    def _decode(self, path: Path, mode: int, problems: list[Problem]) -> NDArray[np.uint8] | None:
        content = _read_bytes(path)
        if not content.startswith(_PNG_SIGNATURE):
            got = "an empty file" if not content else f"bytes {content[:8]!r}"
            problems.append(Problem("not a PNG file", str(path), got=got, fix="fetch it again"))
            return None
        stored = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        # A truncated PNG decodes to an image whose end is missing: the end mark tells.
        if stored is None or b"IEND" not in content[-16:]:
            problems.append(
                Problem("PNG file is damaged", str(path), got=f"{len(content)} bytes, cut short",
                        fix="fetch it again")
            )  # fmt: skip
            return None
        if stored.dtype != np.uint8:
            problems.append(Problem("wrong depth of colour", str(path), "8 bit", str(stored.dtype)))
            return None
        return np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), mode), dtype=np.uint8)

    def _assemble(
        self,
        depths: Mapping[int, NDArray[np.uint8]],
        images: Mapping[Pair, NDArray[np.uint8]],
        shape: tuple[int, ...],
    ) -> SceneImages:
        axes = self._manifest.axes
        extent = tuple(len(values) for values in axes.values())
        infocus = np.zeros((*extent, *shape, 3), np.uint8)
        available = np.zeros(extent, bool)
        for pair, image in images.items():
            place = tuple(axes[axis].index(value) for axis, value in pair.coordinates)
            infocus[place] = image
            available[place] = True
        unknown = self._manifest.depth.unknown
        empty = np.full(shape, unknown, np.uint8)
        depth = np.stack([depths.get(view, empty) for view in axes["view"]])
        return SceneImages(infocus, depth, depth != unknown, available)


def _relative_path(pair: Pair) -> str:
    at = pair.at
    return f"Illum{at['illumination']}/Exp{at['exposure']}/view{at['view']}.png"


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise SourceError(
            Problem("cannot read the file", str(path), got=error.strerror or str(error))
        ) from error
