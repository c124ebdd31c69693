from pathlib import Path

import pytest

from tests.cli.command import Command
from tests.site import Site


def test_list_and_version(dfdbench: Command) -> None:
    listed = dfdbench("list")
    for name in ("demo-1", "middlebury-third-1", "realworld-1", "constant", "local"):
        assert name in listed.out
    for label in ("noise-1", "camera-3"):
        assert label in listed.out
    assert dfdbench("--version").out.startswith("dfdbench ")


def test_info_on_a_track_tells_what_differs_and_no_recipe(
    dfdbench: Command, tiny_toml: str, tiny_folder: Path, tmp_path: Path
) -> None:
    name, place = f"{tiny_toml}@shift-2", str(tmp_path / "tiny-1@shift-2.zarr")
    shown = dfdbench("info", name).out
    assert "shift-2, version 1: the defocus image moved" in shown
    assert "recipe     not told" in shown
    built = dfdbench("build", name, "--source", str(tiny_folder), "--store", place)
    assert built.status == 0, built.err
    stored = dfdbench("info", place).out
    assert "shift-2, version 1: the defocus image moved" in stored
    assert "published" not in stored


def test_the_cache_clears_a_track_by_its_name(
    dfdbench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path))
    for name in ("demo-1.zarr", "demo-1@noise-1.zarr"):
        (tmp_path / "stores" / name).mkdir(parents=True)
    assert "removed 1 entries" in dfdbench("cache", "clear", "demo@noise-1", "--yes").out
    assert [path.name for path in (tmp_path / "stores").iterdir()] == ["demo-1.zarr"]


def test_info_shows_the_data_set_and_lists_pairs_for_a_pipe(dfdbench: Command) -> None:
    shown = dfdbench("info", "middlebury").out
    for part in ("404 pairs", "54 pairs", "Art, Books, Reindeer", "K09", "left out", "Scharstein"):
        assert part in shown
    lines = dfdbench("info", "middlebury", "--pairs", "test").out.splitlines()
    assert len(lines) == 54
    assert lines[0] == "Art/view1/illumination1/exposure0"


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
