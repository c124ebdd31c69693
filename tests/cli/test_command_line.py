import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from dfdbench.datasets.store import Store
from dfdbench.results.record_file import load_result
from tests.cli.command import Command
from tests.conftest import TINY_TOML
from tests.site import Site, served

BELOW = "data/scenes/ThirdSize"


@pytest.fixture
def tiny_toml(tmp_path: Path) -> str:
    path = tmp_path / "tiny-1.toml"
    path.write_text(TINY_TOML)
    return str(path)


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


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["info", "midlebury"], "did you mean middlebury"),
        (["info", "middlebury", "--pairs", "tst"], "did you mean test"),
        (["info", "demo@camra-2"], "did you mean camera"),
        (["build", "demo@camera-5"], "did you mean camera-"),
        (["build", "realworld@camera-1"], "has no tracks"),
        (["build", "demo@law-1", "--recipe", "text"], "leave out --recipe"),
        (["run", "--method", "constant", "--dataset", "demo@law-1"], "dfdbench build demo@law-1"),
        (["build", "middlebury", "--offline"], "--source DIR"),
        (["build", "realworld"], "dfdbench build realworld --source DIR"),
        (["build", "demo", "--recipe", "text"], "--store PATH"),
        (["run", "--method", "mymodule:predict"], "the small one, demo"),
        (["run", "--method", "local", "--protocol", "thesys"], "did you mean thesis"),
        (["check-method", "nosuch:thing"], "no module named nosuch"),
        (["check-method", "lokal"], "did you mean local"),
        (["check-method", "local", "--param", "window"], "NAME=VALUE"),
        (["check-method", "local", "--param", "window=4"], "odd"),
    ],
)
def test_a_mistake_ends_with_a_message_and_status_2(
    dfdbench: Command, arguments: list[str], told: str
) -> None:
    outcome = dfdbench(*arguments)
    assert outcome.status == 2
    assert outcome.err.startswith("error: ")
    assert told in outcome.err
    assert "Traceback" not in outcome.err


def test_running_without_the_set_offers_the_two_commands_that_help(dfdbench: Command) -> None:
    told = dfdbench("run", "--method", "mymodule:predict").err
    assert "dfdbench build middlebury" in told
    assert "the small one, demo" in told


def test_the_whole_way(
    dfdbench: Command, tiny_toml: str, tiny_folder: Path, tmp_path: Path
) -> None:
    store = str(tmp_path / "tiny.zarr")
    built = dfdbench("build", tiny_toml, "--source", str(tiny_folder), "--store", store)
    assert (built.status, "11 pairs" in built.out) == (0, True)
    ran = dfdbench("run", "--method", "mymodule:predict", "--dataset", store)
    assert ran.status == 0
    assert "NRMSE ↓" in ran.out
    assert "predicting" not in ran.out.replace("printed", "")
    folder = Path("results/tiny-test/mymodule-predict")
    assert load_result(folder / "result.json").complete
    assert (folder / "figures/worst.png").exists()
    for form in ("markdown", "json", "csv"):
        shown = dfdbench(
            "run",
            "--method",
            "mymodule:predict",
            "--dataset",
            store,
            "--format",
            form,
            "--protocol",
            "valid",
        )
        assert shown.status == 0
        assert "7 pairs taken over" in shown.err
        if form == "json":
            assert json.loads(shown.out)["protocol"] == "valid"
    failed = dfdbench("run", "--method", "mymodule:nan", "--dataset", store)
    assert failed.status == 1
    assert "NaN" in failed.out
    assert "7 pairs failed" in failed.err


def test_missing_pairs_fail_the_build_unless_allowed(
    dfdbench: Command, tiny_toml: str, tiny_folder: Path, tmp_path: Path
) -> None:
    for png in (tiny_folder / "One").rglob("*.png"):
        png.unlink()
    (tiny_folder / "Two/Illum1/Exp0/view5.png").unlink()
    arguments = (
        "build",
        tiny_toml,
        "--source",
        str(tiny_folder),
        "--store",
        str(tmp_path / "s.zarr"),
    )
    outcome = dfdbench(*arguments)
    assert outcome.status == 2
    assert "missing: 5 of 11 pairs" in outcome.err
    assert "One" in outcome.err
    assert "view5/illumination1/exposure0" in outcome.err
    assert "https://example.org/tiny/One/Illum1/Exp0/view1.png" in outcome.err
    allowed = dfdbench(*arguments, "--allow-missing")
    assert allowed.status == 0
    assert "2 of them kept from before" in allowed.out


def test_check_method_passes_and_fails(dfdbench: Command) -> None:
    good = dfdbench("check-method", "local", "--param", "window=3")
    assert (good.status, "fit for a run" in good.out) == (0, True)
    bad = dfdbench("check-method", "mymodule:nan")
    assert (bad.status, "NaN" in bad.out) == (1, True)


def test_ctrl_c_in_mid_build_loses_nothing(demo_store: Store, tmp_path: Path) -> None:
    store = tmp_path / "demo.zarr"
    command = [sys.executable, "-m", "dfdbench", "build", "demo", "--store", str(store)]
    process = subprocess.Popen(
        # With one worker most scenes are still to come when the first is seen.
        [*command, "--workers", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "DFDBENCH_CACHE": str(tmp_path / "cache")},
    )
    partial = tmp_path / "demo.zarr.partial"
    deadline = time.monotonic() + 60
    while not list(partial.glob("*/defocus")) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "goes on from here" in errors
    assert "Traceback" not in errors
    assert not store.exists()
    again = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert demo_store.fingerprint in again.stdout
    assert "kept from before" in again.stdout


def test_a_closed_pipe_is_no_mistake() -> None:
    command = f"{sys.executable} -m dfdbench info middlebury --pairs all | head -1"
    outcome = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
    assert outcome.stdout == "Aloe/view1/illumination1/exposure0\n".replace("Aloe", "Art")
    assert outcome.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_told() -> None:
    command = f"{sys.executable} -m dfdbench list > /dev/full"
    outcome = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
    assert outcome.returncode == 2
    assert outcome.stderr.startswith("error: cannot write\n")
    assert "Traceback" not in outcome.stderr


@pytest.fixture
def site(tiny_folder: Path, tmp_path: Path) -> Iterator[Site]:
    place = tmp_path / "server" / BELOW
    place.parent.mkdir(parents=True)
    tiny_folder.rename(place)
    with served(tmp_path / "server") as site:
        text = TINY_TOML.replace("https://example.org/tiny", f"{site.address}/{BELOW}")
        (tmp_path / "work").mkdir(exist_ok=True)
        (tmp_path / "work/tiny-1.toml").write_text(text)
        yield site


def test_from_the_site_to_a_verified_store_and_back_to_files(
    dfdbench: Command, site: Site, tmp_path: Path
) -> None:
    cache = ("--cache", str(tmp_path / "mine"))
    built = dfdbench("build", "tiny-1.toml", *cache)
    assert built.status == 0, built.err
    assert "11 pairs of 3 scenes" in built.out
    assert "fetched 17 files" in built.err
    assert "tiny-1.lock" in built.err
    asked = len(site.requests)
    again = dfdbench("build", "tiny-1.toml", "--offline", *cache)
    assert again.status == 0, again.err
    assert "3 of them kept from before" in again.out
    assert len(site.requests) == asked
    store = str(tmp_path / "mine/stores/tiny-1.zarr")
    sound = dfdbench("verify", store)
    assert sound.status == 0
    assert "sound" in sound.out
    shown = dfdbench("info", store)
    assert "11 of 11, 0 missing" in shown.out
    assert "published: sigma_min 0.32" in shown.out
    assert len(dfdbench("info", store, "--pairs", "One").out.splitlines()) == 4
    exported = dfdbench("export", store, "--png", "png")
    assert exported.status == 0
    assert Path("png/One/Illum1/Exp0/view1_lin_0.32_2.88.png").exists()
    chunk = next(path for path in (Path(store) / "One/depth/c").rglob("*") if path.is_file())
    chunk.write_bytes(b"rot")
    broken = dfdbench("verify", store)
    assert broken.status == 1
    assert "One/depth: cannot be decoded" in broken.out
    mended = dfdbench("build", "tiny-1.toml", "--offline", *cache)
    assert "3 scenes, 2 of them kept" in mended.out
    assert dfdbench("verify", store).status == 0


def test_what_the_site_does_not_have_is_told(dfdbench: Command, site: Site) -> None:
    place = site.folder / BELOW
    (place / "One/Illum1/Exp0/view1.png").unlink()
    (place / "Two/Illum1/Exp0/view1.png").write_bytes(b"<html>")
    both = dfdbench("build", "tiny-1.toml")
    assert both.status == 2
    assert "not a PNG file" in both.err
    assert "1 files are missing" in both.err
    assert "set aside in" in both.err
    right = (place / "Two/Illum1/Exp0/view5.png").read_bytes()
    (place / "Two/Illum1/Exp0/view1.png").write_bytes(right)
    missing = dfdbench("build", "tiny-1.toml")
    assert missing.status == 2
    assert "missing: 1 of 11 pairs" in missing.err
    assert "fingerprint" in missing.out
    assert dfdbench("build", "tiny-1.toml", "--allow-missing").status == 0


def test_mirrors_come_from_the_command_line_or_the_environment(
    dfdbench: Command, site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(tmp_path / "server/data") as mirror:
        built = dfdbench("build", "tiny-1.toml", "--mirror", mirror.address)
        assert built.status == 0, built.err
        assert len(mirror.requests) == 17
        monkeypatch.setenv("DFDBENCH_MIRROR", f"{site.address}/nothing {mirror.address}")
        again = dfdbench("build", "tiny-1.toml", "--cache", "other")
        assert again.status == 0, again.err
        assert len(mirror.requests) == 34
    assert not site.asked_for(f"/{BELOW}/One/disp1.png")


def test_middlebury_in_default_lighting_is_whole_and_has_full_tables(
    dfdbench: Command, shared_data: Path
) -> None:
    folder = str(shared_data / "middlebury/ThirdSize")
    built = dfdbench("build", "middlebury-default", "--source", folder)
    assert built.status == 0, built.err
    assert "54 pairs of 27 scenes" in built.out
    ran = dfdbench("run", "--method", "constant", "--dataset", "middlebury-default", "--out", "out")
    assert ran.status == 0, ran.err
    assert "PARTIAL" not in ran.out
    assert "(6 of 6 pairs)" in " ".join(ran.out.split())
    asked = dfdbench("build", "middlebury", "--source", folder, "--default-lighting")
    assert asked.status == 2
    assert "No such option" in asked.err


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


def test_a_cluster_builds_and_runs(
    dfdbench: Command, site: Site, cluster: str, tmp_path: Path
) -> None:
    store, other = str(tmp_path / "tiny.zarr"), str(tmp_path / "other.zarr")
    built = dfdbench("build", "tiny-1.toml", "--store", store, "--scheduler", cluster)
    assert built.status == 0, built.err
    here = dfdbench("build", "tiny-1.toml", "--store", other, "--workers", "2")
    assert built.out.splitlines()[-1] == here.out.splitlines()[-1]
    ran = dfdbench(
        "run", "--method", "constant", "--dataset", store, "--scheduler", cluster, "--out", "out"
    )
    assert ran.status == 0, ran.err
    assert "several at once: not comparable" in " ".join(ran.out.split())
    both = dfdbench("build", "tiny-1.toml", "--scheduler", cluster, "--workers", "2")
    assert both.status == 2
    assert "its own number of workers" in both.err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["build", "demo", "--offline"], "not fetched here"),
        (["build", "tiny-1.toml", "--source", ".", "--mirror", "http://x"], "--mirror"),
        (["build", "demo", "--store", "nosuch://x/y.zarr"], "cannot reach places"),
        (["verify", "nothing.zarr"], "no such store"),
        (["export", "nothing.zarr", "--png", "x"], "no such store"),
        (["info", "nothing.zarr"], "no such store"),
        (["build", "demo", "--scheduler", "nonsense://x"], "no scheduler answers"),
        (["build", "demo", "--store", "memory://x/y.zarr"], "in memory"),
        (["build", "demo", "--recipe", "txt"], "did you mean text"),
        (["build", "tiny-1.toml", "--mirror", "/tmp"], "not an address"),
        (["build", "tiny-1.toml", "--mirror", "http://x", "--offline"], "asks nobody"),
        (["build", "tiny-1.toml", "--cache", "tiny-1.toml"], "cannot keep the download"),
        (["build", "tiny-1.toml", "--source", "tiny-1.toml"], "a file"),
        (["cache", "--cache", "tiny-1.toml"], "no folder"),
        (["info", "./"], "not a data set built by dfdbench"),
    ],
)
def test_more_mistakes(dfdbench: Command, site: Site, arguments: list[str], told: str) -> None:
    outcome = dfdbench(*arguments)
    assert outcome.status == 2
    assert told in outcome.err
    assert "Traceback" not in outcome.err
