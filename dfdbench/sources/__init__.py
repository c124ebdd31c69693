"""Where images and depth maps come from: a module a data set, one interface."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from dfdbench.errors import Problem, SourceError
from dfdbench.manifest import Manifest
from dfdbench.sources.demo import DemoScenes
from dfdbench.sources.interface import SceneImages, Source
from dfdbench.sources.middlebury import MiddleburyScenes
from dfdbench.sources.middlebury_download import Download, download_middlebury

__all__ = ["Download", "SceneImages", "Source", "download_middlebury", "open_source"]


def open_source(
    manifest: Manifest,
    folder: Path | None = None,
    default_lighting: bool = False,
    checksums: Mapping[str, str] | None = None,
) -> Source:
    """Return the source that a manifest names.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    folder : Path, optional
        Where its files lie, for a data set that is read from disk.
    default_lighting, checksums
        See `MiddleburyScenes`.

    Raises
    ------
    SourceError
        Where the data set needs a folder, takes none, or cannot be built by this version.
    """
    if manifest.reader == "demo":
        if folder or default_lighting:
            raise SourceError(
                Problem(f"{manifest.short} is made, not read", fix="leave out --source and "
                        "--default-lighting")
            )  # fmt: skip
        return DemoScenes(manifest)
    if manifest.reader == "middlebury":
        if folder is None:
            raise SourceError(Problem(f"{manifest.short} is read from a folder: name one"))
        return MiddleburyScenes(manifest, folder, default_lighting, checksums)
    raise SourceError(
        Problem(
            f"this version cannot build {manifest.stem}: it has no reader for its files",
            expected="a data set read by: demo, middlebury",
            got=manifest.reader,
        )
    )
