import json
from pathlib import Path

import mlcroissant
import pytest

from dfdbench.datasets import croissant
from dfdbench.datasets.catalog import find_manifest, released_manifests
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.datasets.rendered import seeded
from tests.conftest import TINY_TOML

NAMES = [*(manifest.stem for manifest in released_manifests()), "demo@camera-2"]


@pytest.mark.parametrize("name", NAMES)
def test_a_released_set_is_valid_croissant_with_every_pair(name: str, tmp_path: Path) -> None:
    manifest = find_manifest(name)
    path = tmp_path / "set.json"
    path.write_text(croissant.croissant_text(manifest), "utf-8")
    read = mlcroissant.Dataset(path)
    assert not read.metadata.issues.errors
    assert not read.metadata.issues.warnings
    said = json.loads(path.read_text("utf-8"))
    sets = said.get("recordSet", [{"data": []}])
    ids = [record["pairs/id"] for record in sets[0]["data"]]
    assert ids == [pair.id for pair in manifest.pairs()]
    assert said["distribution"][0]["sha256"] == manifest.sha256


def test_what_conferences_ask_for_is_read_back() -> None:
    metadata = mlcroissant.Dataset(croissant.croissant_of(find_manifest("demo"))).metadata.to_json()
    assert metadata["conformsTo"] == [croissant.CROISSANT, croissant.RESPONSIBLE_AI]
    for field in (
        *("dataLimitations", "dataBiases", "personalSensitiveInformation"),
        *("dataUseCases", "dataSocialImpact", "hasSyntheticData"),
    ):
        assert metadata[f"rai:{field}"]
    assert {"prov:wasDerivedFrom", "prov:wasGeneratedBy"} <= set(metadata)


def test_a_track_says_what_it_does_and_a_set_of_ones_own_promises_no_more_than_it_has() -> None:
    assert "read noise" in croissant.croissant_of(find_manifest("demo@camera-2"))["description"]
    own = croissant.croissant_of(parse_manifest(TINY_TOML.encode(), "tiny-1.toml"))
    assert own["conformsTo"] == croissant.CROISSANT
    assert not [name for name in own if name.startswith(("rai:", "prov:"))]
    assert mlcroissant.Dataset(own).metadata.name == "tiny-1"


def test_every_released_set_has_a_sheet_and_every_sheet_a_set() -> None:
    manifests = released_manifests()
    assert {manifest.short for manifest in manifests} == croissant.datasheets().keys()
    for manifest in manifests:
        sheet = croissant.datasheet_of(manifest)
        assert sheet is not None
        # Whoever reads "captured" must not get what was made.
        made = manifest.recipe or manifest.simulated or seeded(manifest.name)
        assert sheet.synthetic == bool(made)
