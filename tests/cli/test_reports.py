import json
from pathlib import Path

import cv2
import pytest

from dfdbench.results.record import Result
from dfdbench.results.record_file import save_result
from tests.cli.command import Command
from tests.made_results import make_demo_result

SVG = ("--figure-format", "svg")


@pytest.mark.slow
@pytest.mark.usefixtures("built")
def test_runs_are_compared_and_reported(dfdbench: Command) -> None:
    for window in (5, 9):
        name = f"window={window}"
        run = ("run", "--dataset", "demo", "--split", "Market", "--limit", "2")
        dfdbench(*run, "--method", "local", "--param", name, "--out", name)
    compared = dfdbench("compare", "window=5", "window=9/result.json", "--format", "json")
    assert compared.status == 0, compared.err
    assert json.loads(compared.out)[0]["rows"][0]["pairs"] == "all"
    place = "results/compare-demo-1-Market-local-window=5-vs-local-window=9.png"
    assert f"panels       {place}" in compared.err
    panels = cv2.imread(place)
    assert panels is not None
    assert panels.shape[1] == 1800
    both = ("compare", "window=5", "window=9")
    assert "panels       folder/compare.png" in dfdbench(*both, "--out", "folder").err
    assert Path("folder/compare.png").exists()
    sheet = dfdbench(*both, "--format", "csv", "--out", "a.png").out.splitlines()
    assert sheet[0] == "metric,pairs,difference,low,high,wins,losses,ties,verdict"
    assert not any(line.startswith(",") for line in sheet)
    twice = dfdbench("report", "window=5", "window=5/result.json", "--out", "twice")
    assert "given twice, shown once: window=5/result.json" in twice.err
    for arguments, told in (
        (("report", "window=5", "--out", "mymodule.py"), "cannot write the answer"),
        (("report", "window=5", "--out", "mymodule.py/x"), "cannot write the answer"),
        ((*both, "--out", "mymodule.py/a.png"), "cannot write the answer"),
        ((*both, "--out", "mymodule.py"), "not a picture's name"),
        (("compare", "window=5", "window=5/result.json"), "one run is given twice"),
    ):
        outcome = dfdbench(*arguments)
        assert (outcome.status, told in outcome.err) == (2, True), outcome.err
    page = dfdbench("report", "window=5", "window=9", "--out", "page")
    assert page.out.strip() == "page/report.html"
    assert Path("page/report.html").stat().st_size > 100_000
    text = dfdbench("report", "window=5", "--out", "text", *["--format", "markdown"], *SVG)
    assert Path("text/1-seconds-per-pair.svg").read_text("utf-8").startswith("<?xml")
    assert text.out.strip() == "text/report.md"
    assert "an incomplete run has no rank" in Path("text/report.md").read_text("utf-8")
    paper = ("--format", "latex", "--metric", "ssim", "--out", "t.tex", "--figure", "t.png")
    table = dfdbench("report", "window=5", *paper)
    assert (table.status, table.out) == (0, "t.tex\n")
    assert r"& SSIM $\uparrow$ \\" in Path("t.tex").read_text("utf-8")
    assert "no figure: no run is complete" in table.err
    refused = dfdbench("report", "window=5", "--metric", "ssim")
    assert (refused.status, "a page shows every metric and figure" in refused.err) == (2, True)
    named = dfdbench("report", "window=5", "--format", "csv", *SVG)
    assert (named.status, "has the form that its name says" in named.err) == (2, True)
    bare = dfdbench("run", "--dataset", "demo", "--method", "constant", "--no-predictions", *SVG)
    assert (bare.status, "no figures are drawn with --no-predictions" in bare.err) == (2, True)


def version(value: float) -> Result:
    return make_demo_result(lambda _: value, "m:f")


def test_two_versions_of_a_function_are_two_rows(dfdbench: Command) -> None:
    for name, value in (("v1", 0.2), ("v2", 0.1), ("v2.previous", 0.3)):
        save_result(version(value), Path(name, "result.json"))
    given = ("report", "v1", "v2", "v2.previous", "--format")
    for form in ("table", "csv", "latex"):
        found = dfdbench(*given, form)
        assert (found.status, found.err.count("left out: v2.previous, the run before v2;")) == (
            0,
            1,
        )
        assert found.out.index("m:f (v2)") < found.out.index("m:f (v1)")
        assert "previous" not in found.out
    assert "{tab:demo-1-test-thesis}" in found.out
    alone = dfdbench("report", "v2.previous", "--format", "csv")
    assert (alone.err, len(alone.out.splitlines())) == ("", 2)
    against = dfdbench("compare", "v1", "v2", "--format", "latex")
    assert "A: m:f (v1), B: m:f (v2); demo-1" in against.out


def test_a_table_that_cannot_be_written_is_called_by_its_name(dfdbench: Command) -> None:
    save_result(make_demo_result(lambda _: 0.2), Path("v1/result.json"))
    Path("t.tex").mkdir()
    told = dfdbench("report", "v1", "--format", "latex", "--out", "t.tex")
    assert (told.status, "(t.tex)" in told.err) == (2, True), told.err
