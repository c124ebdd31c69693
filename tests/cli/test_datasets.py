import json
from pathlib import Path

import pytest

import dfdbench as package
from dfdbench.datasets.catalog import own_stores
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.fingerprint import signed
from dfdbench.system.packages import EXTRAS
from tests.cli.command import Command
from tests.site import Site


def test_list_and_version(dfdbench: Command) -> None:
    listed = dfdbench("list")
    for name in ("demo", "middlebury", "realworld", "noise-1", "camera-3", "constant", "local"):
        assert name in listed.out
    (line,) = [line for line in listed.out.splitlines() if "realworld-sim " in line]
    assert "SIMULATED" in line
    shown = dfdbench("info realworld-sim").out
    assert shown.startswith("SIMULATED captures")
    assert "the images are SIMULATED captures" in shown
    assert dfdbench("--version").out.startswith("dfdbench ")


def test_a_set_of_ones_own_goes_by_its_name(dfdbench: Command, site: Site, tmp_path: Path) -> None:
    # A folder of that name beside it is what the set was made from, as a rule.
    (tmp_path / "work/tiny").mkdir()
    assert "unknown data set" in dfdbench("info tiny").err
    assert "a folder, and not a data set" in dfdbench("verify tiny").err
    dfdbench("build tiny-1.toml")
    (line,) = [line for line in dfdbench("list").out.splitlines() if line.split()[:1] == ["tiny"]]
    assert line.split()[:4] == ["tiny", "3", "11", "yes"]
    store = own_stores()["tiny"]
    for name in ("tiny", "tiny-1"):
        assert dfdbench("info", name).out == dfdbench("info", str(store)).out
        assert dfdbench("verify", name).status == 0
    assert dfdbench("info tiny --croissant").status == 0
    dfdbench.fine("run --method constant --dataset tiny --out run --no-figures")
    (store / "zarr.json").write_text("{}")
    (line,) = [line for line in dfdbench("list").out.splitlines() if line.split()[:1] == ["tiny"]]
    assert "not a data set built by dfdbench" in line


def test_the_cache_is_listed_and_cleared(dfdbench: Command, site: Site) -> None:
    dfdbench("build tiny-1.toml")
    track = own_stores()["tiny"].with_name("demo-1@noise-1.zarr")
    track.mkdir()
    assert "removed 1 entries" in dfdbench("cache clear demo@noise-1 --yes").out
    assert not track.exists()
    listed = dfdbench("cache").out
    assert "tiny-1.zarr" in listed
    assert "downloads" in listed
    dfdbench.refused("--yes", "cache clear")
    assert "did you mean stores" in dfdbench("cache clear store --yes").err
    assert "removed 1 entries" in dfdbench("cache clear stores --yes").out
    assert "tiny-1.zarr" not in dfdbench("cache").out
    assert dfdbench("build tiny-1.toml --offline").status == 0
    assert "removed 2 entries" in dfdbench("cache clear tiny --yes").out
    dfdbench("build tiny-1.toml")
    assert "removed 2 entries" in dfdbench("cache clear --yes").out
    assert "nothing to remove" in dfdbench("cache clear --yes").out


def test_info_on_a_track_tells_what_differs_and_no_recipe(
    dfdbench: Command, tiny_toml: str, tiny_folder: Path, tmp_path: Path
) -> None:
    name, place = f"{tiny_toml}@shift-2", str(tmp_path / "tiny-1@shift-2.zarr")
    shown = dfdbench("info", name).out
    assert "shift-2, version 1: the defocus image moved" in shown
    assert "recipe     not given" in shown
    dfdbench.fine("build", name, "--source", str(tiny_folder), "--store", place)
    stored = dfdbench("info", place).out
    assert "shift-2, version 1: the defocus image moved" in stored
    assert "published" not in stored


def test_info_shows_the_data_set_and_lists_pairs_for_a_pipe(dfdbench: Command) -> None:
    shown = dfdbench("info middlebury").out
    for part in ("404 pairs", "54 pairs", "Art, Books, Reindeer", "K09", "left out", "Scharstein"):
        assert part in shown
    assert "brighter is nearer; " in shown
    assert "  depth      metres, from 0.3 m to 20 m\n" in dfdbench("info zedd").out
    lines = dfdbench("info middlebury --pairs test").out.splitlines()
    assert (len(lines), lines[0]) == (54, "Art/view1/illumination1/exposure0")


def test_info_of_others_text_steers_no_terminal(
    dfdbench: Command, tiny_toml: str, tiny_store: Dataset
) -> None:
    text = Path(tiny_toml).read_text().replace("Tiny set", "Tiny\\u001b[2J")
    Path(tiny_toml).write_text(text)
    place = Path(str(tiny_store.path)) / "zarr.json"
    content = json.loads(place.read_text())
    others = {**content["attributes"], "dfdbench_version": "Tiny\x1b[2J"}
    place.write_text(json.dumps({**content, "attributes": signed(others)}))
    for name in (tiny_toml, str(tiny_store.path)):
        shown = dfdbench("info", name).out
        assert "\x1b" not in shown
        assert "Tiny\\x1b[2J\n" in shown


def test_it_tells_versions_extras_and_what_lies_in_the_cache(
    dfdbench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(EXTRAS, "none", ("there_is_no_such_module",))
    (tmp_path / "stores" / "mine-1.zarr").mkdir(parents=True)
    (tmp_path / "stores" / ".mine-1.zarr.removed").mkdir()
    (tmp_path / "stores/mine-1.zarr/chunk").write_bytes(bytes(2_500_000))
    (table,) = dfdbench.facts("doctor --cache", str(tmp_path))["tables"]
    told = {row["what"]: row["found"] for row in table["rows"]}
    assert told["dfdbench"].startswith(package.__version__)
    assert told["built"] == "mine-1"
    assert told["cache"].startswith(f"{tmp_path}: 2.5 MB, ")
    assert "torch" in told["extra nets"]
    assert told["trains on cpu in"].split(":")[0] in ("float32", "bf16")
    assert Path(told["compiled code"]).is_dir()
    assert told["extra none"] == "absent: pip install 'dfdbench[none]'"
