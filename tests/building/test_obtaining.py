from pathlib import Path

import pytest

from dfdbench.building import obtaining
from dfdbench.building.sources import Source
from dfdbench.datasets.catalog import default_store, find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError
from tests.conftest import make_published

MIDDLEBURY, REALWORLD = find_manifest("middlebury"), find_manifest("realworld")


@pytest.mark.parametrize("mirror", ["/data/middlebury", "ftp://mirror.example", "https:///folder"])
def test_a_mirror_is_an_address(tmp_path: Path, mirror: str) -> None:
    with pytest.raises(InputError, match=f"not an address.*{mirror}"):
        obtaining.obtain(MIDDLEBURY, mirrors=["https://right.example", mirror], cache=tmp_path)


@pytest.mark.parametrize("pair", ["135", "a-b", "-135-129", "135-129-141"])
def test_what_is_no_pair_of_steps_is_told(tmp_path: Path, pair: str) -> None:
    with pytest.raises(InputError, match=rf"not a pair of voltage steps.*, got {pair}$"):
        obtaining.voltage_pair_sets(REALWORLD, ["135-129", pair], None, tmp_path)


def test_each_pair_has_a_place_beside_the_sets_own_and_is_built_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    published = make_published(tmp_path / "site", ["k33"])
    built: dict[Path, object] = {}

    def note(manifest: Manifest, source: Source, place: Path, *others: object) -> None:
        built[place] = source.options

    monkeypatch.setattr(obtaining, "build_store", note)
    monkeypatch.setattr(obtaining, "Dataset", Path)
    first, second = (
        tmp_path / f"stores/{REALWORLD.stem}-{pair}.zarr" for pair in ("135-129", "141-129")
    )
    found = obtaining.voltage_pair_sets(REALWORLD, ["135-129", "141-129"], published, tmp_path)
    assert list(found) == ["135-129", "141-129"]
    assert [str(place) for place in found.values()] == [str(first), str(second)]
    # The manifest's own pair too: the set that `build` makes is never taken for an experiment's.
    assert default_store(REALWORLD, tmp_path) not in built
    assert built == {first: {"pair": [135, 129]}, second: {"pair": [141, 129]}}
    # What is there is not built again, and needs no captures any more.
    first.mkdir(parents=True)
    built.clear()
    obtaining.voltage_pair_sets(REALWORLD, ["135-129", "141-129"], published, tmp_path)
    assert list(built) == [second]
    assert obtaining.voltage_pair_sets(REALWORLD, ["135-129"], None, tmp_path)
    assert list(built) == [second]
