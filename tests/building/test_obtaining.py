import shutil
from pathlib import Path

import pytest

from dfdbench.building import obtaining
from dfdbench.building.obtaining import obtain, voltage_pair_sets
from dfdbench.building.sources import Source
from dfdbench.datasets.catalog import default_store, find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError
from tests.conftest import make_published


@pytest.mark.parametrize("mirror", ["/data/middlebury", "ftp://mirror.example", "https:///folder"])
def test_a_mirror_is_an_address(tmp_path: Path, mirror: str) -> None:
    with pytest.raises(InputError, match=f"not an address.*{mirror}"):
        obtain(
            find_manifest("middlebury"), mirrors=["https://right.example", mirror], cache=tmp_path
        )


def test_what_is_asked_about_fetching_is_refused_where_nothing_is_fetched(tmp_path: Path) -> None:
    demo, middlebury = (find_manifest(name) for name in ("demo", "middlebury"))
    assert obtain(demo)[1] is None
    with pytest.raises(InputError, match="demo is not fetched here"):
        obtain(demo, offline=True)
    with pytest.raises(InputError, match=r"reads a copy on disk.*\(--mirror and --offline\)"):
        obtain(middlebury, tmp_path, ["https://a.example"], offline=True)


def test_offline_what_lies_there_is_the_source(
    tiny_manifest: Manifest, tiny_folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"no file of tiny is there[^$]*without --offline"):
        obtain(tiny_manifest, offline=True, cache=tmp_path / "cache")
    shutil.copytree(tiny_folder, tmp_path / "cache/downloads/tiny-1", dirs_exist_ok=True)
    source, done = obtain(tiny_manifest, offline=True, cache=tmp_path / "cache")
    assert done is not None
    assert (done.new, done.kept) == (0, 17)
    assert len(source.available_pairs()) == 11


REALWORLD = find_manifest("realworld")


@pytest.fixture
def published(tmp_path: Path) -> Path:
    return make_published(tmp_path / "site", ["k33"])


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> dict[Path, object]:
    """By place, the options of what would be built."""
    found: dict[Path, object] = {}

    def note(manifest: Manifest, source: Source, place: Path, *others: object) -> None:
        found[place] = source.options

    monkeypatch.setattr(obtaining, "build_store", note)
    monkeypatch.setattr(obtaining, "Dataset", Path)
    return found


def test_each_pair_has_a_place_beside_the_sets_own(
    published: Path, tmp_path: Path, built: dict[Path, object]
) -> None:
    first, second = (
        tmp_path / f"stores/{REALWORLD.stem}-{pair}.zarr" for pair in ("135-129", "141-129")
    )
    found = voltage_pair_sets(REALWORLD, ["135-129", "141-129"], published, tmp_path)
    assert {pair: str(place) for pair, place in found.items()} == {
        "135-129": str(first),
        "141-129": str(second),
    }
    # The manifest's own pair too: the set that `build` makes is never taken for an experiment's.
    assert default_store(REALWORLD, tmp_path) not in built
    assert built == {first: {"pair": [135, 129]}, second: {"pair": [141, 129]}}


def test_what_is_built_is_not_built_again(
    published: Path, tmp_path: Path, built: dict[Path, object]
) -> None:
    (tmp_path / f"stores/{REALWORLD.stem}-135-129.zarr").mkdir(parents=True)
    voltage_pair_sets(REALWORLD, ["135-129", "141-129"], published, tmp_path)
    assert [place.stem for place in built] == [f"{REALWORLD.stem}-141-129"]
    # And needs no captures any more.
    assert voltage_pair_sets(REALWORLD, ["135-129"], None, tmp_path)
    assert len(built) == 1


@pytest.mark.parametrize("pair", ["135", "135,129", "135-", "a-b", "-135-129", "135-129-141"])
def test_what_is_no_pair_of_steps_is_told(published: Path, tmp_path: Path, pair: str) -> None:
    with pytest.raises(InputError, match=rf"not a pair of voltage steps.*, got {pair}$"):
        voltage_pair_sets(REALWORLD, ["135-129", pair], published, tmp_path)
