import json
import re
from pathlib import Path

from dfdbench.datasets.dataset import Dataset
from dfdbench.results.record_file import load_result
from tests.cli.command import Command


def test_running_without_the_set_offers_the_two_commands_that_help(dfdbench: Command) -> None:
    told = dfdbench("run", "--method", "mymodule:predict").err
    assert "dfdbench build middlebury" in told
    assert "`dfdbench build demo`, then `--dataset demo`" in told


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
            "--no-figures",
        )
        assert shown.status == 0
        assert "figures " not in shown.err
        assert "7 pairs taken over" in shown.err
        if form == "json":
            assert json.loads(shown.out)["protocol"] == "valid"
    plain = dfdbench(
        "run", "--method", "constant", "--dataset", store, "--limit", "1", "--no-figures"
    )
    assert plain.status == 0
    assert sorted(path.name for path in Path("results/tiny-test/constant").iterdir()) == [
        "pairs.jsonl",
        "predictions.zarr",
        "result.json",
        "run.json",
        "store.txt",
    ]
    failed = dfdbench("run", "--method", "mymodule:nan", "--dataset", store)
    assert failed.status == 1
    assert "NaN" in failed.out
    assert "7 pairs failed" in failed.err
    scores = r"NRMSE 0\.\d{4}  NMAE 0\.\d{4}  SSIM 0\.\d{4}"
    last = rf"overall      {scores}  \(protocol valid, split test, 7 pairs\)"
    assert re.fullmatch(last, ran.err.splitlines()[-1])
    assert "overall      no score: 1 of 7 pairs were evaluated" in plain.err
    one = ("--dataset", store, "--limit", "1", "--out", "one")
    assert (
        "\n1 pair failed; the same command tries it again\n"
        in dfdbench("run", "--method", "mymodule:nan", *one).err
    )


def test_a_protocol_that_is_not_scored_there_is_told_before_the_run(
    dfdbench: Command, demo_store: Dataset, tmp_path: Path
) -> None:
    store = str(demo_store.path)
    asked = ("run", "--method", "mymodule:predict", "--dataset", store, "--protocol", "metric")
    told = dfdbench(*asked, "--out", "run")
    assert told.status == 2
    assert "not scored in metres" in told.err
    assert not (tmp_path / "work/run").exists()
