"""Published numbers are what the thesis's tables say."""

import csv
from pathlib import Path

import pytest

from leaderboard.published import load_published, published_summary

FOLDER = Path(__file__).parents[1] / "leaderboard"
PUBLISHED = load_published(FOLDER)
TABLES = {table.table: table for table in PUBLISHED if table.kind == "table"}


@pytest.fixture
def reference(shared_data: Path) -> Path:
    folder = shared_data.parent / "reference/tables"
    if not folder.is_dir():
        pytest.skip("no transcribed tables beside the shared images")
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_every_number_is_the_transcribed_one(reference: Path) -> None:
    compared = 0
    for line in rows(reference / "middlebury_lighting.csv"):
        (row,) = [
            row
            for row in TABLES[line["table"]].rows
            if row.method == line["method"].replace("unet", "u-net")
            and row.at == {key: line[key] for key in ("exposure", "illumination")}
        ]
        assert str(row.scores[line["metric"]]) == line["mean"]
        assert str(row.std.get(line["metric"], "")) == line["std"]
        compared += 1
    for file in ("middlebury_top_bottom", "realworld_top_bottom", "summaries"):
        lines = rows(reference / f"{file}.csv")
        for table in {line["table"] for line in lines}:
            expected = [line for line in lines if line["table"] == table]
            for line, row in zip(expected, TABLES[table].rows, strict=True):
                for metric in ("nrmse", "nmae", "ssim"):
                    assert str(row.scores[metric]) == line[metric]
                compared += 3
    for file, table in (("middlebury_9fold", "5.7"), ("voltage_pairs", "7.5")):
        for line, row in zip(rows(reference / f"{file}.csv"), TABLES[table].rows, strict=True):
            assert str(row.scores["nrmse"]) == line["nrmse"]
            compared += 1
    for line in rows(reference / "run_times.csv"):
        found = [str(row.seconds) for row in TABLES[line["table"]].rows]
        assert line["seconds_per_image"] in found
        compared += 1
    assert compared > 350


def test_the_summary_is_in_order_and_bears_no_rank() -> None:
    shown = published_summary(list(TABLES.values()), "middlebury-test")
    assert [row[0] for row in shown.rows] == ["dfd-net-pso", "dfd-net", "graph-cuts", "u-net"]
    assert "not ranked" in shown.title
    # The thesis's text gives the mean of DfD-Net PSO: 0.0517, 0.0154, 0.9156.
    assert shown.rows[0][1:4] == ("0.0517", "0.0154", "0.9156")
    assert "10.029 (AMD Ryzen 7 1800X)" in shown.rows[1][7]
