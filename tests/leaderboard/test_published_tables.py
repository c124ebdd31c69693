from pathlib import Path

from dfdbench.leaderboard.published import load_published
from dfdbench.leaderboard.published_tables import published_summary, published_table

FOLDER = Path(__file__).parents[2] / "leaderboard"


PUBLISHED = load_published(FOLDER)


TABLES = {table.table: table for table in PUBLISHED if table.kind == "table"}


def test_printed_digits_are_kept() -> None:
    shown = published_table(TABLES["4.2"])
    assert shown.rows[2][5] == "0.05600"
    assert "Table 4.2 (section 4.2)" in shown.title


def test_the_summary_is_in_order_and_bears_no_rank() -> None:
    shown = published_summary(list(TABLES.values()), "middlebury-test")
    assert [row[0] for row in shown.rows] == ["dfd-net-pso", "dfd-net", "graph-cuts", "u-net"]
    assert "not ranked" in shown.title
    # The thesis's text gives the mean of DfD-Net PSO: 0.0517, 0.0154, 0.9156.
    assert shown.rows[0][1:4] == ("0.0517", "0.0154", "0.9156")
    assert "10.029 (AMD Ryzen 7 1800X)" in shown.rows[1][7]


def test_values_that_are_no_scores_are_shown_by_column() -> None:
    shown = published_table(TABLES["D.1"])
    assert shown.columns[:3] == ("statistic", "52", "48")
    assert shown.rows[0][:3] == ("minimum", "33", "39")
    assert shown.notes[0].startswith("Numbers: clusters found, by layer.")
