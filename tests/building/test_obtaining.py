import shutil
from pathlib import Path

import numpy as np
import pytest

from dfdbench.building.build import plan_build
from dfdbench.building.obtaining import obtain, voltage_pair_sets
from dfdbench.datasets.catalog import default_store, find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError
from tests.conftest import write_png


@pytest.mark.parametrize("mirror", ["/data/middlebury", "ftp://mirror.example", "https:///folder"])
def test_a_mirror_is_an_address(tmp_path: Path, mirror: str) -> None:
    plan = plan_build(find_manifest("middlebury"), cache=tmp_path)
    with pytest.raises(InputError, match=f"not an address.*{mirror}"):
        obtain(plan, mirrors=["https://right.example", mirror], cache=tmp_path)


def test_what_is_asked_about_fetching_is_refused_where_nothing_is_fetched(tmp_path: Path) -> None:
    demo, middlebury = (plan_build(find_manifest(name)) for name in ("demo", "middlebury"))
    assert obtain(demo).folder is None
    with pytest.raises(InputError, match="demo is not fetched here"):
        obtain(demo, offline=True)
    with pytest.raises(InputError, match="reads a copy on disk") as caught:
        obtain(middlebury, tmp_path, ["https://a.example"], offline=True)
    assert caught.value.problems[0].where == "--mirror and --offline"


def test_offline_what_lies_there_is_the_source(
    tiny_manifest: Manifest, tiny_folder: Path, tmp_path: Path
) -> None:
    plan = plan_build(tiny_manifest, cache=tmp_path / "cache")
    with pytest.raises(InputError, match=r"no file of tiny is there[^$]*without --offline"):
        obtain(plan, offline=True, cache=tmp_path / "cache")
    shutil.copytree(tiny_folder, tmp_path / "cache/downloads/tiny-1", dirs_exist_ok=True)
    found = obtain(plan, offline=True, cache=tmp_path / "cache")
    assert found.done is not None
    assert (found.done.new, found.done.kept) == (0, 17)
    assert len(found.source.available_pairs()) == 11


REALWORLD = find_manifest("realworld")


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """The files of one scene: they are looked for, not read."""
    for step in (129, 135, 141):
        image = np.zeros((630, 630, 3), np.uint8)
        write_png(tmp_path / f"site/k33/left/exp_30/image_{step}_30.00.png", image)
    levels = np.full((630, 630), 9, np.uint8)
    write_png(tmp_path / "site/k33/lidar/lidar_rng_left_00000_8bit_x6.png", levels)
    return tmp_path / "site"


def test_each_pair_has_a_place_beside_the_sets_own(site: Path, tmp_path: Path) -> None:
    places, to_build = voltage_pair_sets(REALWORLD, ["135-129", "141-129"], site, tmp_path)
    assert places == {
        "135-129": tmp_path / f"stores/{REALWORLD.stem}-135-129.zarr",
        "141-129": tmp_path / f"stores/{REALWORLD.stem}-141-129.zarr",
    }
    # The manifest's own pair too: the set that `build` makes is never taken for an experiment's.
    assert default_store(REALWORLD, tmp_path) not in places.values()
    assert {pair: source.options for pair, source in to_build.items()} == {
        "135-129": {"pair": [135, 129]},
        "141-129": {"pair": [141, 129]},
    }


def test_what_is_built_is_not_built_again(site: Path, tmp_path: Path) -> None:
    (tmp_path / f"stores/{REALWORLD.stem}-135-129.zarr").mkdir(parents=True)
    assert [*voltage_pair_sets(REALWORLD, ["135-129", "141-129"], site, tmp_path)[1]] == ["141-129"]
    # And needs no captures any more.
    assert not voltage_pair_sets(REALWORLD, ["135-129"], None, tmp_path)[1]


@pytest.mark.parametrize("pair", ["135", "135,129", "135-", "a-b", "-135-129", "135-129-141"])
def test_what_is_no_pair_of_steps_is_told(site: Path, tmp_path: Path, pair: str) -> None:
    with pytest.raises(InputError, match="not a pair of voltage steps") as caught:
        voltage_pair_sets(REALWORLD, ["135-129", pair], site, tmp_path)
    assert caught.value.problems[0].got == pair
