import csv
import io
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench import __version__
from dfdbench.datasets.dataset import Dataset
from dfdbench.results.record import save_result
from tests.board.made_boards import make_folder
from tests.cli.command import Command
from tests.conftest import rewrite_array
from tests.made_results import make_demo_result

SVG = ("--figure-format", "svg")


@pytest.mark.slow
@pytest.mark.usefixtures("demo_built")
def test_runs_are_compared_and_reported(dfdbench: Command) -> None:
    for name in ("window=5", "window=9"):
        run = "run --dataset demo --split Market --limit 2 --method local"
        dfdbench.fine(f"{run} --param {name} --out {name}")
    compared = dfdbench.fine("compare window=5 window=9/result.json --format json")
    assert json.loads(compared.out)["tables"][0]["rows"][0]["pairs"] == "all"
    place = "results/compare-demo-1-Market-local-window=5-vs-local-window=9.png"
    assert f"figure       {place}" in compared.err
    assert np.asarray(cv2.imread(place)).shape[1] == 1800
    csv_form = dfdbench("compare window=5 window=9 --format csv --out folder")
    assert "figure       folder/compare.png" in csv_form.err
    assert Path("folder/compare.png").exists()
    heading, *lines = csv_form.out.splitlines()
    assert heading == "metric,pairs,difference,low,high,wins,losses,ties,p,verdict"
    assert not any(line.startswith(",") for line in lines)
    for words, told in (
        ("report window=5 --out mymodule.py", "exists (mymodule.py)\nFix: choose another place"),
        ("compare window=5 window=9 --out mymodule.py/a.png", "exists (mymodule.py)\nFix: choose"),
        ("compare window=5 window=9 --out mymodule.py", "not a picture's name"),
        ("compare window=5 window=5/result.json", "one run is given twice"),
    ):
        dfdbench.refused(told, words)
    both = "report window=5 window=9 mymodule.py --out page"  # as a shell's star names it
    assert dfdbench(both).out.strip() == "page/report.html"
    assert Path("page/report.html").stat().st_size > 100_000
    text = dfdbench("report window=5 --out text --format markdown", *SVG)
    assert Path("text/1-seconds-per-pair.svg").read_text("utf-8").startswith("<?xml")
    assert text.out.strip() == "text/report.md"
    assert "an incomplete run has no rank" in Path("text/report.md").read_text("utf-8")
    table = dfdbench("report window=5 --format latex --metric ssim --out t.tex --figure t.png")
    assert (table.status, table.out) == (0, "t.tex\n")
    assert r"& SSIM $\uparrow$ \\" in Path("t.tex").read_text("utf-8")
    assert "no figure: no run is complete" in table.err
    dfdbench.refused("add --format table, latex, csv or json", "report window=5 --metric ssim")
    dfdbench.refused(
        "--figure-format cannot be given with --format csv", "report window=5 --format csv", *SVG
    )
    bare = "run --dataset demo --method constant --no-predictions"
    dfdbench.refused("--figure-format cannot be given with --no-predictions", bare, *SVG)


def test_a_table_that_cannot_be_written_is_called_by_its_name(dfdbench: Command) -> None:
    save_result(make_demo_result(lambda _: 0.2), Path("v1/result.json"))
    Path("t.tex").mkdir()
    dfdbench.refused("(t.tex)", "report v1 --format latex --out t.tex")


@pytest.mark.usefixtures("small_demo_built")
def test_from_a_run_to_the_leaderboard(dfdbench: Command) -> None:
    assert f"rows of dfdbench {__version__}\n" in dfdbench.fine("leaderboard --format csv").err
    make_folder("constant")
    submitted = dfdbench.fine("run --dataset demo --method constant --submit --no-figures")
    path = "leaderboard/results/demo-1-test/constant.json"
    assert f"submission   {path}" in submitted.err
    assert Path(path).exists()
    assert "stale" in dfdbench("leaderboard --check").err
    written = dfdbench("leaderboard --dataset demo --format csv")
    rows = list(csv.DictReader(io.StringIO(written.out)))
    assert [row["protocol"] for row in rows] == ["valid", "thesis", "thesis-networks-2"]
    assert "1 row valid" in dfdbench("leaderboard --check").out
    assert "\\toprule" in dfdbench("leaderboard --format latex").out
    assert dfdbench.facts("leaderboard")["tables"][0]["rows"][0]["rank"] == 1
    assert "constant" in dfdbench("leaderboard").out
    (row,) = dfdbench.facts("leaderboard verify", path, "--pairs", "2")["rows"]
    assert (row["verified"], len(row["pairs"]), row["drawn_from"]) == (True, 2, 54)


@pytest.mark.usefixtures("small_demo_built")
def test_mistakes_are_told(dfdbench: Command) -> None:
    make_folder("constant")
    dfdbench("run --dataset demo --method constant --submit --no-predictions")
    result = "results/demo-1-test/constant/result.json"
    row = "leaderboard/results/demo-1-test/constant.json"
    Path("copy.json").write_bytes(Path(result).read_bytes())
    bare = dfdbench.fine("compare", result, "copy.json")
    assert "no panels: no depth maps lie beside" in bare.err
    for words, told in (
        (f"compare {result} {row}", "unknown field"),
        (f"compare nowhere {result}", "cannot read the result"),
        (f"report {result} --out page --protocol metric", "metric needs depth in metres"),
        (f"compare {result} copy.json --protocol thesys", "did you mean thesis"),
        ("leaderboard --folder nowhere", "no leaderboard"),
        ("leaderboard --check --format csv", "--format cannot be given with --check"),
        ("leaderboard --dataset dmo", "did you mean demo"),
    ):
        dfdbench.refused(told, words)


def test_a_run_on_a_damaged_store_is_not_submitted(dfdbench: Command, tiny_store: Dataset) -> None:
    make_folder("constant")
    rewrite_array(tiny_store, "Two/depth", np.fliplr)
    run = f"run --dataset {tiny_store.path} --method constant --split One --submit"
    assert "Two/depth" in dfdbench.refused("does not hold what was built", run).err
    assert not Path("results").exists()


@pytest.mark.usefixtures("small_demo_built")
def test_no_card_and_weights_trained_on_the_test_are_refused_before_the_run(
    dfdbench: Command,
) -> None:
    make_folder("learned.py:predict")
    run = "run --dataset demo --method mymodule:predict --submit"
    refused = dfdbench.refused("mymodule:predict has no card (leaderboard/methods)", run)
    assert "Fix: write one, NAME.toml: title, authors" in refused.err
    Path("learned.py").write_text(
        "def predict(infocus, defocus):\n    raise RuntimeError('called')\n"
        f"predict.trained_on = 'demo-1, split train'\npredict.weights_sha256 = '{'5' * 64}'\n"
    )
    run = "run --method learned.py:predict --dataset demo --no-figures --split"
    refused = dfdbench.refused("trained on scenes of the test", f"{run} all --submit")
    assert "Garage" in refused.err
    assert not Path("results").exists()
    # Without --submit it is one's own affair: a warning in the result.
    assert "leak" in dfdbench(f"{run} Attic --limit 1").out
