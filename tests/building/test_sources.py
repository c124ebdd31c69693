from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from dfdbench.building import build_store
from dfdbench.building.sources import ENTRY_POINT_GROUP, Source, is_made, open_source
from dfdbench.building.sources.demo import DemoScenes
from dfdbench.building.sources.middlebury import MiddleburyScenes
from dfdbench.building.sources.realworld import RealworldFolder
from dfdbench.datasets.catalog import find_manifest, released_manifests
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import SourceError
from tests.made_source import MadeSource


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
    assert ("defocus" in images.facts.roles) == source.captures_defocus
    assert isinstance(source.missing_help(pairs[:1]), str)


def test_what_is_made_needs_no_files() -> None:
    made = [manifest.short for manifest in released_manifests() if is_made(manifest)]
    assert made == ["demo", "realworld-sim", "unseen", "unseen-stack"]


def test_each_reader_has_a_source(
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
    with pytest.raises(SourceError, match="and none is named"):
        open_source(find_manifest("middlebury"))
    with pytest.raises(SourceError, match="reads no folder"):
        open_source(find_manifest("demo"), tmp_path)
    unknown = find_manifest("demo").model_copy(update={"reader": "tapes"})
    with pytest.raises(SourceError, match="no reader tapes for the files"):
        open_source(unknown)


def noise(manifest: Manifest, folder: Path | None) -> MadeSource:
    """Make a source as a package may offer one."""
    extent = tuple(len(values) for values in manifest.axes.values())
    infocus = np.random.default_rng(1).integers(1, 256, (*extent, 20, 24, 3)).astype(np.uint8)
    return MadeSource(manifest, infocus, np.full((extent[0], 20, 24), 90, np.uint8))


def test_packages_offer_sources(
    tiny_manifest: Manifest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    offered = EntryPoint("noise", f"{__name__}:noise", ENTRY_POINT_GROUP)
    broken = EntryPoint("torn", f"{__name__}:Torn", ENTRY_POINT_GROUP)

    def entry_points(group: str) -> list[EntryPoint]:
        assert group == ENTRY_POINT_GROUP == "dfdbench.sources"
        return [offered, broken]

    monkeypatch.setattr("dfdbench.system.packages.entry_points", entry_points)
    manifest = tiny_manifest.model_copy(update={"reader": "noise"})
    source = open_source(manifest, tmp_path)
    assert isinstance(source, MadeSource)
    check_interface(source, manifest)
    report = build_store(manifest, source, tmp_path / "noise.zarr")
    assert (report.pairs, report.missing) == (11, ())
    with pytest.raises(SourceError, match="cannot be imported"):
        open_source(tiny_manifest.model_copy(update={"reader": "torn"}))
    told = "no reader tapes.*folder, middlebury, noise, realworld, realworld-sim, torn"
    with pytest.raises(SourceError, match=told):
        open_source(tiny_manifest.model_copy(update={"reader": "tapes"}))
