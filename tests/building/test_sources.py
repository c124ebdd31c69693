from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from dfdbench.building import build_store
from dfdbench.building.sources import ENTRY_POINT_GROUP, open_source
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError, SourceError
from tests.made_source import MadeSource


def test_what_cannot_be_opened_says_what_is_lacking(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="and none is named"):
        open_source(find_manifest("middlebury"))
    with pytest.raises(InputError, match="--source cannot be given with demo"):
        open_source(find_manifest("demo"), tmp_path)


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
    report = build_store(manifest, source, tmp_path / "noise.zarr")
    assert (report.pairs, report.missing) == (11, ())
    with pytest.raises(SourceError, match="cannot be imported"):
        open_source(tiny_manifest.model_copy(update={"reader": "torn"}))
    told = "no reader tapes.*folder, middlebury, noise, realworld, realworld-sim, torn"
    with pytest.raises(SourceError, match=told):
        open_source(tiny_manifest.model_copy(update={"reader": "tapes"}))
