import json
from pathlib import Path

import pytest

from dfdbench.datasets.store import Store
from dfdbench.results.record_file import load_result
from tests.cli.command import Command


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


def test_check_method_passes_and_fails(dfdbench: Command) -> None:
    told = ("--param", "window=3", "--param", "recipe=published")
    good = dfdbench("check-method", "local", *told)
    assert (good.status, "fit for a run" in good.out) == (0, True)
    bad = dfdbench("check-method", "mymodule:nan")
    assert (bad.status, "NaN" in bad.out) == (1, True)


@pytest.mark.slow
def test_check_method_calibrates_a_method_that_is_not_told_the_blur(dfdbench: Command) -> None:
    good = dfdbench("check-method", "local", "--param", "window=3")
    assert (good.status, "fit for a run" in good.out) == (0, True)
    assert "fit, on two made pairs" in good.out


def test_a_protocol_that_is_not_scored_there_is_told_before_the_run(
    dfdbench: Command, demo_store: Store, tmp_path: Path
) -> None:
    store = str(demo_store.path)
    asked = ("run", "--method", "mymodule:predict", "--dataset", store, "--protocol", "metric")
    told = dfdbench(*asked, "--out", "run")
    assert told.status == 2
    assert "not scored in metres" in told.err
    assert not (tmp_path / "work/run").exists()
