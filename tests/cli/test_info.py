import json
from pathlib import Path

from dfdbench.datasets.dataset import Dataset
from tests.cli.command import Command


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


def test_info_shows_the_data_set_and_lists_pairs_for_a_pipe(dfdbench: Command) -> None:
    shown = dfdbench("info", "middlebury").out
    for part in ("404 pairs", "54 pairs", "Art, Books, Reindeer", "K09", "left out", "Scharstein"):
        assert part in shown
    lines = dfdbench("info", "middlebury", "--pairs", "test").out.splitlines()
    assert len(lines) == 54
    assert lines[0] == "Art/view1/illumination1/exposure0"


def test_info_prints_croissant_of_a_name_and_of_a_store(
    dfdbench: Command, tiny_toml: str, tiny_folder: Path, tmp_path: Path
) -> None:
    told = json.loads(dfdbench("info", "demo", "--croissant").out)
    assert (told["name"], told["version"]) == ("demo-1", "1.0.0")
    store = str(tmp_path / "tiny.zarr")
    dfdbench("build", tiny_toml, "--source", str(tiny_folder), "--store", store)
    assert json.loads(dfdbench("info", store, "--croissant").out)["name"] == "tiny-1"


def test_info_shows_whatever_another_packages_source_found_out(
    tiny_store: Dataset, dfdbench: Command
) -> None:
    about = Path(str(tiny_store.path)) / "One/zarr.json"
    content = json.loads(about.read_text())
    content["attributes"]["found"] = {
        "view1": {"down": 0.5, "right": -1.25},
        "view5": {"down": 0.5},
        "lens": ["f/2.8", 10**400],
        "note": "\u202e" + 300 * "a",
    }
    about.write_text(json.dumps(content))
    shown = dfdbench("info", str(tiny_store.path)).out
    assert "what lays one image on the other" in shown
    assert "-1.25" in shown
    assert "what the source found out" in shown
    assert '["f/2.8", 1000' in shown
    assert "\u202e" not in shown
    assert "…" in shown
