import csv
import io
import json

import pytest

from dfdbench.results.run_data import run_as_csv, run_as_json
from dfdbench.results.run_tables import run_tables
from dfdbench.results.summary import summarise
from dfdbench.tables.render import render
from dfdbench.tables.table import Format
from tests.made_results import make_result

VALUES = {
    (scene, view, illumination, exposure): 0.01 * (1 + number)
    for number, (scene, view, illumination, exposure) in enumerate(
        (s, v, i, e) for s in ("a", "b") for v in (1, 5) for i in (1, 2) for e in (0, 1)
    )
}


def test_markdown_csv_and_json_say_the_same() -> None:
    summary = summarise(make_result(VALUES), "thesis")
    markdown = render(run_tables(summary), Format.markdown)
    assert "| overall |  | 0.0850 |" in markdown
    rows = list(csv.DictReader(io.StringIO(run_as_csv(summary))))
    whole = [row for row in rows if row["exposure"] == "all" and row["metric"] == "nrmse"]
    assert float(whole[0]["mean"]) == pytest.approx(0.085)
    content = json.loads(run_as_json(summary))
    assert content["groups"][-1]["nrmse"]["mean"] == pytest.approx(0.085)
    assert content["top"][0]["pair"] == "a/view1/illumination1/exposure0"
