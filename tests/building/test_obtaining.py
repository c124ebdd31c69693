from pathlib import Path

import numpy as np
import pytest

from dfdbench.building.build import build_store
from dfdbench.building.obtaining import (
    Fetching,
    download_folder,
    fetch_source,
    is_fetched,
    refuse_to_fetch,
    voltage_pair_sets,
)
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.store_place import default_store
from dfdbench.errors import InputError, SourceError
from tests.conftest import write_png

OFFLINE = Fetching(offline=True)


@pytest.mark.parametrize(
    ("mirror", "right"),
    [
        ("https://mirror.example/middlebury", True),
        ("http://127.0.0.1:8000", True),
        ("/data/middlebury", False),
        ("mirror.example/middlebury", False),
        ("ftp://mirror.example", False),
        ("https://", False),
        ("https:///folder", False),
    ],
)
def test_a_mirror_is_an_address(mirror: str, right: bool) -> None:
    if right:
        assert Fetching((mirror,)).mirrors == (mirror,)
        return
    with pytest.raises(InputError, match="not an address") as caught:
        Fetching(("https://right.example", mirror))
    assert mirror in caught.value.problems[0].what


def test_middlebury_alone_is_fetched_and_only_without_a_folder(tmp_path: Path) -> None:
    for name, fetched in (("middlebury", True), ("middlebury-default", True), ("demo", False)):
        assert is_fetched(find_manifest(name), None) is fetched
        assert not is_fetched(find_manifest(name), tmp_path)
    assert not is_fetched(find_manifest("realworld"), None)


def test_what_is_asked_about_fetching_is_refused_where_nothing_is_fetched(tmp_path: Path) -> None:
    demo, middlebury = find_manifest("demo"), find_manifest("middlebury")
    refuse_to_fetch(demo, None, ())
    refuse_to_fetch(middlebury, tmp_path, ())
    with pytest.raises(InputError, match="demo is not fetched here"):
        refuse_to_fetch(demo, None, ("--offline",))
    with pytest.raises(InputError, match="reads a copy on disk") as caught:
        refuse_to_fetch(middlebury, tmp_path, ("--mirror", "--offline"))
    assert caught.value.problems[0].where == "--mirror and --offline"


def test_offline_what_lies_there_is_the_source(tiny_manifest: Manifest, tiny_folder: Path) -> None:
    source, done = fetch_source(tiny_manifest, tiny_folder, OFFLINE)
    assert (done.new, done.kept) == (0, 17)
    assert len(source.available_pairs()) == 11


def test_offline_with_nothing_there_is_told(tiny_manifest: Manifest, tmp_path: Path) -> None:
    folder = download_folder(tiny_manifest, tmp_path)
    assert folder == tmp_path / "downloads/tiny-1"
    with pytest.raises(InputError, match="no file of tiny is there") as caught:
        fetch_source(tiny_manifest, folder, OFFLINE)
    assert "build once without --offline" in caught.value.problems[0].fix


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
    sets = voltage_pair_sets(REALWORLD, ["135-129", "141-129"], site, tmp_path)
    assert sets.places == {
        "135-129": tmp_path / f"stores/{REALWORLD.stem}-135-129.zarr",
        "141-129": tmp_path / f"stores/{REALWORLD.stem}-141-129.zarr",
    }
    # The manifest's own pair too: the set that `build` makes is never taken for an experiment's.
    assert default_store(REALWORLD, tmp_path) not in sets.places.values()
    assert {pair: source.options for pair, source in sets.to_build.items()} == {
        "135-129": {"pair": [135, 129]},
        "141-129": {"pair": [141, 129]},
    }


def test_what_is_built_is_not_built_again(site: Path, tmp_path: Path) -> None:
    (tmp_path / f"stores/{REALWORLD.stem}-135-129.zarr").mkdir(parents=True)
    assert list(voltage_pair_sets(REALWORLD, ["135-129", "141-129"], site, tmp_path).to_build) == [
        "141-129"
    ]
    # And needs no captures any more.
    assert not voltage_pair_sets(REALWORLD, ["135-129"], None, tmp_path).to_build


def test_without_captures_all_that_is_not_built_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--source DIR") as caught:
        voltage_pair_sets(REALWORLD, ["135-129", "141-129"], None, tmp_path)
    assert caught.value.problems[0].what.endswith("135-129, 141-129")


@pytest.mark.parametrize("pair", ["135", "135,129", "135-", "a-b", "-135-129", "135-129-141"])
def test_what_is_no_pair_of_steps_is_told(site: Path, tmp_path: Path, pair: str) -> None:
    with pytest.raises(InputError, match="not a pair of voltage steps") as caught:
        voltage_pair_sets(REALWORLD, ["135-129", pair], site, tmp_path)
    assert caught.value.problems[0].got == pair


def test_a_step_that_the_lens_never_had_is_told_before_anything_is_built(
    site: Path, tmp_path: Path
) -> None:
    with pytest.raises(SourceError, match="two steps of 127 to 143"):
        voltage_pair_sets(REALWORLD, ["135-129", "135-150"], site, tmp_path)


def test_another_pair_is_kept_out_of_the_sets_own_place(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path))
    sets = voltage_pair_sets(REALWORLD, ["135-129"], site, tmp_path)
    with pytest.raises(InputError, match="make another data set"):
        build_store(REALWORLD, sets.to_build["135-129"], default_store(REALWORLD))
