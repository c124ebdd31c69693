import json
from pathlib import Path

import cv2
import pytest

from tests.cli.command import Command


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
    assert "panels       window=5/compare.png" in dfdbench(*both, "--out", "window=5").err
    assert Path("window=5/compare.png").exists()
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
        (("compare", "window=5", "window=5/result.json"), "A and B are the same run"),
    ):
        outcome = dfdbench(*arguments)
        assert (outcome.status, told in outcome.err) == (2, True), outcome.err
    page = dfdbench("report", "window=5", "window=9", "--out", "page")
    assert page.out.strip() == "page/report.html"
    assert Path("page/report.html").stat().st_size > 100_000
    text = dfdbench("report", "window=5", "--out", "text", "--format", "markdown")
    assert text.out.strip() == "text/report.md"
    assert "an incomplete run has no rank" in Path("text/report.md").read_text("utf-8")
