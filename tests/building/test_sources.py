from pathlib import Path

import pytest

from dfdbench.building.sources import Source, open_source
from dfdbench.building.sources.demo import DemoScenes
from dfdbench.building.sources.middlebury import MiddleburyScenes
from dfdbench.building.sources.realworld import RealworldFolder
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import SourceError


def check_interface(source: Source, manifest: Manifest) -> None:
    """What a build relies on, of whichever source."""
    pairs = source.available_pairs()
    assert pairs
    assert list(pairs) == [pair for pair in manifest.pairs() if pair in set(pairs)]
    assert len(source.signature(pairs[0].scene)) == 64
    assert source.captures_defocus == (manifest.recipe is None)
    images = source.read(pairs[0].scene)
    on_axes = tuple(len(values) for values in manifest.axes.values())
    assert images.available.shape == on_axes
    assert images.infocus.shape[: len(on_axes)] == on_axes
    assert images.depth.shape == images.valid.shape
    assert images.infocus.shape[len(on_axes) : -1] == images.depth.shape[-2:]
    assert (images.defocus is not None) == source.captures_defocus
    assert isinstance(source.missing_help(pairs[:1]), str)


def test_each_reader_has_its_source(
    tiny_manifest: Manifest, tiny_folder: Path, captures: Path
) -> None:
    for manifest, folder, kind in (
        (find_manifest("demo"), None, DemoScenes),
        (tiny_manifest, tiny_folder, MiddleburyScenes),
        (find_manifest("realworld"), captures, RealworldFolder),
    ):
        source = open_source(manifest, folder)
        assert isinstance(source, kind)
        check_interface(source, manifest)


def test_what_cannot_be_opened_says_what_is_lacking(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="simulate realworld"):
        open_source(find_manifest("realworld"))
    with pytest.raises(SourceError, match="name one"):
        open_source(find_manifest("middlebury"))
    with pytest.raises(SourceError, match="made, not read"):
        open_source(find_manifest("demo"), tmp_path)
    with pytest.raises(SourceError, match="has no voltage steps"):
        open_source(find_manifest("middlebury"), tmp_path, pair=(141, 129))
    unknown = find_manifest("demo").model_copy(update={"reader": "tapes"})
    with pytest.raises(SourceError, match="it has no reader for its files"):
        open_source(unknown)
