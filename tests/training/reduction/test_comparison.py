from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, UnknownNameError
from dfdbench.methods.networks.weights import Card
from dfdbench.training.reduction.comparison import (
    comparison_table,
    configurations_in,
    seconds_an_image,
)
from tests.methods.made_weights import card, save_small


def scored(nrmse: float, **changes: object) -> Card:
    scores = {"nrmse": nrmse, "nmae": nrmse / 2, "ssim": 1 - nrmse}
    further = {"thesis-networks-2": {"nrmse": nrmse / 10}}
    return card(scores=scores, further_scores=further, **changes)


CARDS = [
    ("original", scored(0.10, parameters=200)),
    ("original", scored(0.14, parameters=200)),
    ("B-01-01", scored(0.11, parameters=90)),
    ("B-01-01", scored(0.17, parameters=90)),
]


def test_best_is_compared_with_best_and_mean_with_mean() -> None:
    table = comparison_table("T", CARDS, {"original": 0.5, "B-01-01": 0.25})
    rows = {row[0]: row for row in table.rows}
    assert rows["B-01-01"][1:4] == ("90", "0.250", "2")
    assert rows["B-01-01"][4:6] == ("0.1100", "0.1400")
    record = table.records[1]
    assert record["ssim_best"] == pytest.approx(0.89)  # the larger of the two
    # The reduced network's best, 0.11, is below the baseline's mean, 0.12, and beats nothing.
    assert record["best_to_best"] == pytest.approx(0.01)
    assert record["mean_to_mean"] == pytest.approx(0.02)
    assert rows["B-01-01"][-2:] == ("+0.0100", "+0.0200")
    assert rows["original"][-2:] == ("+0.0000", "+0.0000")
    assert "says nothing" in table.notes[1]


def test_without_the_baseline_nothing_is_compared_and_protocols_are_apart() -> None:
    assert comparison_table("T", CARDS[2:], {}).rows[0][-2:] == ("–", "–")
    table = comparison_table("T", CARDS, {}, "thesis-networks-2")
    assert table.records[1]["nrmse_mean"] == pytest.approx(0.014)
    assert table.rows[1][2] == "–"
    assert table.rows[1][6:8] == ("–", "–")


def test_rows_are_those_of_the_folder_and_others_are_named(tmp_path: Path) -> None:
    for name in ("B-01-01", "original", "B-01-02"):
        (tmp_path / f"{name}.toml").write_text("")
    assert list(configurations_in(tmp_path, None)) == ["original", "B-01-01", "B-01-02"]
    assert list(configurations_in(tmp_path, ["B-01-02"])) == ["B-01-02"]
    with pytest.raises(UnknownNameError, match="B-01-02"):
        configurations_in(tmp_path, ["B-01-03"])
    with pytest.raises(InputError, match="lacks original"):
        configurations_in(tmp_path / "nowhere", None)


def test_seconds_are_of_an_answer(tiny_store: Dataset, tmp_path: Path) -> None:
    small = save_small(tmp_path / "w.safetensors")
    seconds = seconds_an_image({"original": small, "B-01-01": small}, tiny_store, "cpu")
    assert list(seconds) == ["original", "B-01-01"]
    assert all(0 < value < 30 for value in seconds.values())
