from dfdbench.datasets.catalog import find_manifest, released_manifests
from dfdbench.datasets.datasheet import datasheet_of, datasheets
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.datasets.unseen import seeded
from tests.conftest import TINY_TOML


def test_every_released_set_has_a_sheet_and_every_sheet_a_set() -> None:
    manifests = released_manifests()
    assert {manifest.short for manifest in manifests} == datasheets().keys()
    for manifest in manifests:
        sheet = datasheet_of(manifest)
        assert sheet is not None
        # Whoever reads "captured" must not get what was made.
        made = manifest.recipe or manifest.simulated or seeded(manifest.name)
        assert sheet.synthetic == bool(made)


def test_a_track_has_the_sheet_of_its_set_and_a_set_of_ones_own_none() -> None:
    assert datasheet_of(find_manifest("demo@camera-2")) == datasheets()["demo"]
    own = TINY_TOML.replace('short = "tiny"', 'short = "demo"')
    assert datasheet_of(parse_manifest(own.encode(), "tiny-1.toml")) is None
