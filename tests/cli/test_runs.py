import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

import dfdbench as package
from dfdbench.datasets.dataset import Dataset
from dfdbench.results.record import load_result
from tests.board.made_boards import make_folder
from tests.cli.command import Command


def test_the_whole_way(
    dfdbench: Command, tiny_toml: str, tiny_folder: Path, tmp_path: Path
) -> None:
    store = str(tmp_path / "tiny.zarr")
    built = dfdbench.fine("build", tiny_toml, "--source", str(tiny_folder), "--store", store)
    assert "11 pairs" in built.out
    ran = dfdbench.fine("run --method mymodule:predict --dataset", store)
    assert "NRMSE ↓" in ran.out
    assert "predicting" not in ran.out.replace("printed", "")
    folder = Path("results/tiny-test/mymodule-predict")
    assert load_result(folder / "result.json").complete
    assert (folder / "figures/worst.png").exists()
    again = f"run --method mymodule:predict --dataset {store} --protocol valid --no-figures"
    shown = dfdbench.fine(f"{again} --format json")
    assert "figures " not in shown.err
    assert "7 pairs kept from an earlier run" in shown.err
    told = json.loads(shown.out)
    assert (told["tables"][0]["rows"][0]["protocol"], told["folder"]) == ("valid", str(folder))
    verdict = told["verdict"]
    said = [f"{key:<12} {line['text']}" for key, line in verdict.items()]
    assert said == shown.err.splitlines()[-4:-1]
    means = (load_result(folder / "result.json").averages or {})["valid"]
    assert {name: verdict["score"][name] for name in means} == means
    assert 0 < verdict["constant"]["nrmse"] < verdict["worst"]["nrmse"]
    for form, first in (("markdown", "| exposure |"), ("csv", "exposure,")):
        assert first in dfdbench.fine(f"{again} --format {form}").out
    plain = dfdbench.fine(
        f"run --method constant --dataset {store} --workers 1 --limit 1 --no-figures",
        "--cache=my cache",
    )
    kept = sorted(path.name for path in Path("results/tiny-test/constant").iterdir())
    assert " ".join(kept) == "pairs.jsonl predictions.zarr result.json run.json store.txt tables.md"
    failed = dfdbench("run --method mymodule:nan --no-figures --dataset", store)
    assert failed.status == 1
    assert "NaN" in failed.out
    assert "7 pairs failed" in failed.err
    scores = r"NRMSE 0\.\d{4}  NMAE 0\.\d{4}  SSIM 0\.\d{4}"
    score, constant, worst, then = ran.err.splitlines()[-4:]
    assert re.fullmatch(rf"score        {scores}  \(protocol valid, split test, 7 pairs\)", score)
    assert re.match(rf"constant     {scores}: your NRMSE is \d+ % (high|low)er", constant)
    assert re.match(r"worst        .*pair Three/view1/\S+, NRMSE 0\.\d{4}", worst), worst
    assert then == f"next         dfdbench report {folder}"
    score, then = (plain.err.splitlines()[at] for at in (-2, -1))
    assert score.endswith("(protocol valid, split test, only 1 of 7 pairs)")
    again = f"dfdbench run --dataset {store} --split test --method constant --workers 1"
    assert then == f"next         {again} --cache 'my cache'"
    one = dfdbench(f"run --method mymodule:nan --dataset {store} --limit 1 --out one")
    assert "1 pair failed; the same command tries it again\n" in one.err


def test_a_protocol_not_scored_there_is_told_before(dfdbench: Command, tiny_store: Dataset) -> None:
    asked = f"run --method mymodule:predict --dataset {tiny_store.path} --protocol metric"
    dfdbench.refused("metric needs depth in metres", f"{asked} --out run")
    assert not Path("run").exists()


def test_what_has_no_tracks_is_told_before_anything_is_built(
    dfdbench: Command, tiny_store: Dataset
) -> None:
    for words, said in (
        ("--dataset demo@noise-1", "--track NAME chooses"),
        ("--dataset realworld", "captured"),
        ("--track nois", "did you mean noise"),
        ("--submit", "no leaderboard here"),
        ("--dataset middlebury-default", "dfdbench build"),
    ):
        dfdbench.refused(said, f"tracks --method constant {words}")
        assert not Path(os.environ["DFDBENCH_CACHE"]).exists()
    words = f"tracks --method constant --dataset {tiny_store.path}"
    dfdbench.refused("built from a set's manifest", words)


def test_a_method_that_always_fails_ends_the_tracks_and_is_to_be_checked(
    dfdbench: Command, small_demo: Dataset, small_demo_built: Path
) -> None:
    for number in (1, 2, 3):
        # Never run on: the clean images come first.
        track = small_demo_built / f"stores/demo-1@gain-{number}.zarr"
        track.symlink_to(str(small_demo.path))
    words = "--method mymodule:nan --dataset demo --split Market"
    dfdbench.refused("it failed on every pair of demo-1", f"tracks {words} --track gain")
    assert not Path("results/demo-1-tracks-Market/mymodule-nan/gain-1").exists()
    unsure = "--method mymodule:predict --dataset demo --split Market --protocol sure"
    dfdbench.refused("neither says how sure it is", f"tracks {unsure} --track gain")
    assert not Path("results/demo-1-tracks-Market/mymodule-predict/gain-1").exists()
    ran = dfdbench(f"run {words} --limit 1 --no-figures")
    assert ran.err.endswith("next         dfdbench check-method mymodule:nan\n")


def test_parameters_are_tried_on_training_captures(dfdbench: Command, few_demo: Dataset) -> None:
    words = f"tune --method s-transform --dataset {few_demo.path} --limit 4"
    given = "--param recipe=null --param window=5 --range window=7,9"
    tuned = dfdbench.fine(f"{words} {given} --seed 1", "--cache=my cache")
    assert "training captures" in tuned.out
    assert "window" in tuned.out
    assert "drawn at random with the seed" in " ".join(dfdbench("tune --help").out.split())
    last = tuned.err.splitlines()[-1]
    params = "--param recipe=null --param window=([79])"
    found = re.search(f"--method s-transform {params} --seed 1 --cache 'my cache'$", last)
    assert found, last
    assert found[1] in tuned.out.splitlines()[4]


@pytest.mark.slow
def test_a_method_is_run_on_clean_images_and_on_each_severity(
    dfdbench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path / "cache"))
    words = "tracks --method constant --split Market --track gain"
    first = dfdbench.fine(f"{words} --format json")
    (row,) = json.loads(first.out)["tables"][0]["rows"]
    # A constant looks at no image: no track can change its score.
    assert row["nrmse clean"] == row["nrmse 1"] == row["nrmse 3"] > 0
    folder = Path("results/demo-1-tracks-Market/constant")
    assert (folder / "tracks.png").stat().st_size > 10_000
    labels = ["clean", "gain-1", "gain-2", "gain-3"]
    assert sorted(path.parent.name for path in folder.glob("*/result.json")) == labels
    told = [line.split() for line in first.err.splitlines()]
    assert [words[0] for words in told if words[1:2] == ["NRMSE"]] == labels
    opened = package.open_run(folder)
    assert list(opened.table("valid").index) == labels
    assert set(opened.scores["severity"]) == {0, 1, 2, 3}
    written = {label: (folder / label / "pairs.jsonl").read_bytes() for label in labels}
    dfdbench.fine(words)
    assert {label: (folder / label / "pairs.jsonl").read_bytes() for label in labels} == written


@pytest.mark.slow
@pytest.mark.usefixtures("demo_built")
def test_a_folder_is_scored_and_submitted(dfdbench: Command, demo_store: Dataset) -> None:
    ids = dfdbench("info demo --pairs test").out.split()
    pairs = {pair.id: pair for pair in demo_store.pairs("test")}
    for name in ids:
        path = Path("elsewhere", f"{name}.npy")
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, demo_store.read_levels(pairs[name])[0])
    make_folder("elsewhere")
    asked = "score --predictions elsewhere --dataset demo --submit"
    assert "elsewhere (scored, not run) on demo-1, split test" in dfdbench.fine(asked).out
    folder = Path("results/demo-1-test/elsewhere-scored")
    assert (load_result(folder).averages or {})["thesis"]["nrmse"] == 0
    assert (folder / "figures/worst.png").is_file()
    assert [path.name for path in Path("leaderboard/results").rglob("*.json")] == ["elsewhere.json"]
    assert "elsewhere" in dfdbench.fine("leaderboard").out
    assert "moved to" in dfdbench(asked, "--method", "elsewhere").err
