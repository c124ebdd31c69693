from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.errors import InputError
from dfdbench.leaderboard.published import load_published
from dfdbench.methods.networks.widths import FILTERS, LAYERS
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.configuration_file import read_configuration
from dfdbench.training.reduction.counts import STATISTICS, Counts, Statistic
from dfdbench.training.reduction.rows import (
    LEVELS,
    as_toml,
    ensemble_rows,
    iterative_rows,
    rounded,
    rows_of,
    rows_table,
)

BOARD = Path(__file__).parents[3] / "leaderboard"


def table_d_1() -> dict[Statistic, dict[int, int]]:
    (table,) = (table for table in load_published(BOARD) if table.name == "Table D.1")
    counts = [{int(layer): int(n) for layer, n in row.values.items()} for row in table.rows]
    return dict(zip(STATISTICS, counts, strict=True))


def test_the_nine_rows_b_follow_from_table_d_1() -> None:
    rows = ensemble_rows(table_d_1())
    assert len(rows) == 9
    assert rows == {name: widths for name, widths in FILTERS.items() if name.startswith("B")}


def test_the_last_stages_rows_f_are_those_of_table_d_2() -> None:
    # The counts of that stage, read off the rows: which of 34 and 29 had the smaller is not known.
    stage: dict[Statistic, dict[int, int]] = {
        "min": {34: 145, 29: 185, 32: 206, 27: 129},
        "max": {34: 160, 29: 190, 32: 253, 27: 145},
        "mean": {34: 188, 29: 155, 32: 226, 27: 139},
    }
    others = dict.fromkeys((*LAYERS, 2), 7)
    before = FILTERS["F-01-01"]
    rows = iterative_rows({name: others | found for name, found in stage.items()}, 3, before)
    assert rows == {name: FILTERS[name] for name in rows}
    assert list(rows) == ["F-01-01", "F-01-02", "F-02-01", "F-02-02", "F-03-01", "F-03-02"]


def test_a_level_leaves_all_other_layers_as_they_are() -> None:
    base = FILTERS["original"]
    for level, layers in LEVELS.items():
        rows = iterative_rows(table_d_1(), level, base)
        assert len(rows) == (9 if level == 1 else 6)
        for widths in rows.values():
            changed = {
                layer
                for layer, one, other in zip(LAYERS, widths, base, strict=True)
                if one != other
            }
            assert changed == set(layers)
    assert iterative_rows(table_d_1(), 1, base)["F1-02-03"][14:17] == (70, 19, 70)
    with pytest.raises(InputError, match="1, 2 or 3"):
        iterative_rows(table_d_1(), 4, base)


def test_h_is_printed_exactly_and_l_goes_down_everywhere() -> None:
    row = {"F-02-02": FILTERS["F-02-02"]}
    assert rounded(row, "H") == {"F-02-02H": FILTERS["F-02-02H"]}
    low = rounded(row, "L")["F-02-02L"]
    assert all(a <= b and a % 8 == 0 for a, b in zip(low, FILTERS["F-02-02"], strict=True))
    # As printed, only these four of the layers that are no multiple go down.
    printed = dict(zip(LAYERS, FILTERS["F-02-02L"], strict=True))
    ours = dict(zip(LAYERS, low, strict=True))
    assert [ours[layer] for layer in (48, 40, 27, 8)] == [
        printed[layer] for layer in (48, 40, 27, 8)
    ]
    assert rounded({"x": (5, 256)}, "L") == {"xL": (8, 256)}


def test_counts_make_the_rows_of_an_ensemble_or_a_level() -> None:
    d_1 = table_d_1()
    found = {layer: (d_1["min"][layer], d_1["max"][layer]) for layer in d_1["min"]}
    counts = Counts(dict.fromkeys(found, 512), found, found, ("a", "b"))
    base = FILTERS["original"]
    assert rows_of(counts, base, None)["B-03-03"] == FILTERS["B-03-03"]
    assert set(rows_of(counts, base, 3)) == {name for name in FILTERS if name[:2] == "F-"} - {
        "F-02-02L",
        "F-02-02H",
    }


def test_a_row_is_a_configuration_that_train_reads(tmp_path: Path) -> None:
    choices = TrainingConfiguration(
        narrow=8, noise=2, tracks=("noise",), minimum_learning_rate=1e-9
    )
    path = tmp_path / "row.toml"
    path.write_text(as_toml(choices, FILTERS["B-01-01"], "B-01-01 of mine"))
    read = read_configuration(str(path))
    expected = {"filters": list(FILTERS["B-01-01"]), "narrow": 1}
    assert read == choices.model_copy(update=expected)
    assert read.architecture("dfd-net")["filters"] == list(FILTERS["B-01-01"])
    assert "steps" not in tomllib.loads(path.read_text())


def test_the_table_has_the_form_of_d_2() -> None:
    table = rows_table({"B-01-01": FILTERS["B-01-01"]}, {"B-01-01": 1_727_497}, "T")
    assert table.columns[1:19] == tuple(map(str, LAYERS))
    assert table.rows[0][0] == "B-01-01"
    assert table.rows[0][-1] == "1,727,497"
