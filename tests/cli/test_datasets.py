from pathlib import Path

import pytest

from dfdbench.datasets.store_place import own_stores
from tests.cli.command import Command
from tests.site import Site


def test_list_and_version(dfdbench: Command) -> None:
    listed = dfdbench("list")
    for name in ("demo-1", "middlebury-third-1", "realworld-1", "constant", "local"):
        assert name in listed.out
    for label in ("noise-1", "camera-3"):
        assert label in listed.out
    assert dfdbench("--version").out.startswith("dfdbench ")


def test_a_set_of_ones_own_goes_by_its_name_once_built(
    dfdbench: Command, site: Site, tmp_path: Path
) -> None:
    # A folder of that name beside it is what the set was made from, as a rule.
    (tmp_path / "work/tiny").mkdir()
    assert "unknown data set" in dfdbench("info", "tiny").err
    assert "a folder, and not a data set" in dfdbench("verify", "tiny").err
    dfdbench("build", "tiny-1.toml")
    (line,) = [line for line in dfdbench("list").out.splitlines() if "tiny-1" in line]
    assert line.split()[:5] == ["tiny", "tiny-1", "3", "11", "yes"]
    store = own_stores()["tiny"]
    for name in ("tiny", "tiny-1"):
        assert dfdbench("info", name).out == dfdbench("info", str(store)).out
        assert dfdbench("verify", name).status == 0
    assert dfdbench("info", "tiny", "--croissant").status == 0
    ran = dfdbench("run", "--method", "constant", "--dataset", "tiny", "--out", "run")
    assert ran.status == 0
    (store / "zarr.json").write_text("{}")
    (line,) = [line for line in dfdbench("list").out.splitlines() if "tiny-1" in line]
    assert "not a data set built by dfdbench" in line


def test_simulated_captures_are_shown_as_such(dfdbench: Command) -> None:
    (line,) = [line for line in dfdbench("list").out.splitlines() if "realworld-sim-1" in line]
    assert "SIMULATED" in line
    shown = dfdbench("info", "realworld-sim").out
    assert shown.startswith("SIMULATED captures")
    assert "both images are SIMULATED captures" in shown


def test_the_cache_clears_a_track_by_its_name(
    dfdbench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path))
    for name in ("demo-1.zarr", "demo-1@noise-1.zarr"):
        (tmp_path / "stores" / name).mkdir(parents=True)
    assert "removed 1 entries" in dfdbench("cache", "clear", "demo@noise-1", "--yes").out
    assert [path.name for path in (tmp_path / "stores").iterdir()] == ["demo-1.zarr"]


def test_the_cache_is_listed_and_cleared(dfdbench: Command, site: Site) -> None:
    dfdbench("build", "tiny-1.toml")
    listed = dfdbench("cache").out
    assert "tiny-1.zarr" in listed
    assert "downloads" in listed
    asked = dfdbench("cache", "clear")
    assert asked.status == 2
    assert "--yes" in asked.err
    assert "did you mean stores" in dfdbench("cache", "clear", "store", "--yes").err
    assert "removed 1 entries" in dfdbench("cache", "clear", "stores", "--yes").out
    assert "tiny-1.zarr" not in dfdbench("cache").out
    assert dfdbench("build", "tiny-1.toml", "--offline").status == 0
    assert "removed 2 entries" in dfdbench("cache", "clear", "--yes").out
    assert "nothing to remove" in dfdbench("cache", "clear", "--yes").out
