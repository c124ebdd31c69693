from pathlib import Path

import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, UnknownNameError
from dfdbench.methods.networks.choices import FILTERS, LAYERS
from dfdbench.methods.networks.weights import Card, build_network, count_parameters, save_weights
from dfdbench.training.configuration import TrainingConfiguration, read_configuration
from dfdbench.training.reduction import counts, reduce
from dfdbench.training.reduction.counts import STATISTICS, Statistic
from leaderboard.published import load_published
from tests.methods.made_weights import card, save_small
from tests.methods.networks.test_architectures import SMALL


def test_weights_become_narrower_configurations(tiny_store: Dataset, tmp_path: Path) -> None:
    rare = {"redraw_depth": True, "tracks": ("noise",), "minimum_learning_rate": 1e-9}
    choices = TrainingConfiguration.model_validate({"narrow": 8, "crop": 16, "noise": 2, **rare})
    small = save_small(tmp_path / "w.safetensors")
    assert 0 < reduce.seconds_an_image({"mine": small}, tiny_store, "cpu")["mine"] < 30
    found = reduce.reduce_weights(small, tiny_store, choices)
    assert (list(found.rows)[:2], len(found.rows)) == ([reduce.BASELINE, "B-01-01"], 10)
    assert found.rows[reduce.BASELINE] == tuple(SMALL)
    folder = tmp_path / "out"
    folder.mkdir()
    # Of what is there, only an earlier call's files go.
    for name, text in (("F-01-01.toml", "old"), ("mine.toml", ""), ("rows.csv", "F-01-01,8\n")):
        (folder / name).write_text(text)
    found.write(folder)
    tables = {"counts.md", "counts.csv", "rows.md", "rows.csv", "mine.toml"}
    assert {path.name for path in folder.iterdir()} == set(found.files) | tables
    for name, widths in found.rows.items():
        read = read_configuration(str(folder / f"{name}.toml"))
        assert read == choices.model_copy(update={"filters": list(widths), "narrow": 1})
        built = build_network("dfd-net", read.architecture("dfd-net"))
        parameters = dict(zip(found.rows, found.tables[1].rows, strict=True))[name][-1]
        assert f"{count_parameters(built):,}" == parameters
    assert "counted on tiny-1, split test" in (folder / "B-01-01.toml").read_text()


def test_there_is_no_level_0(
    tiny_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    none = counts.Counts({}, {}, {}, ())
    monkeypatch.setattr(counts, "count_clusters", lambda *_: none)
    small = save_small(tmp_path / "w.safetensors")
    with pytest.raises(InputError, match="there is no level 0"):
        reduce.reduce_weights(small, tiny_store, TrainingConfiguration(), level=0)


def test_layers_stay_as_they_are_and_rounding_adds_rows(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    architecture = {"filters": list(SMALL), "sampling_size": 3, "first_activation": "sigmoid"}
    path = tmp_path / "w.safetensors"
    save_weights(path, build_network("dfd-net", architecture), card(architecture=architecture))
    # Layers are the network's, not those of the configuration that says how to train.
    other = TrainingConfiguration(kernels=[5] * 14, activations=["relu"] * 9, normalized=False)
    found = reduce.reduce_weights(path, tiny_store, other, level=2, rounding="L", split="train")
    names = [f"F2-0{n}-0{m}{end}" for end in ("", "L") for n in (1, 2, 3) for m in (1, 2)]
    assert list(found.rows)[1:] == names
    for text in found.files.values():
        assert "sampling_size = 3\n" in text
        assert 'first_activation = "sigmoid"\n' in text
        assert not any(name in text for name in ("kernels", "activations", "normalized"))


BOARD = Path(__file__).parents[3] / "leaderboard"


def table_d_1() -> dict[Statistic, dict[int, int]]:
    (table,) = (table for table in load_published(BOARD) if table.name == "Table D.1")
    counts = [{int(layer): int(n) for layer, n in row.values.items()} for row in table.rows]
    return dict(zip(STATISTICS, counts, strict=True))


def test_the_nine_rows_b_follow_from_table_d_1() -> None:
    rows = reduce.ensemble_rows(table_d_1())
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
    rows = reduce.iterative_rows({name: others | found for name, found in stage.items()}, 3, before)
    assert rows == {name: FILTERS[name] for name in rows}
    assert list(rows) == ["F-01-01", "F-01-02", "F-02-01", "F-02-02", "F-03-01", "F-03-02"]


def test_a_level_leaves_all_other_layers_as_they_are() -> None:
    base = FILTERS["original"]
    for level, layers in reduce.LEVELS.items():
        rows = reduce.iterative_rows(table_d_1(), level, base)
        assert len(rows) == (9 if level == 1 else 6)
        for widths in rows.values():
            both = zip(LAYERS, widths, base, strict=True)
            assert {layer for layer, one, other in both if one != other} == set(layers)
    assert reduce.iterative_rows(table_d_1(), 1, base)["F1-02-03"][14:17] == (70, 19, 70)
    with pytest.raises(InputError, match="only 1, 2 and 3"):
        reduce.iterative_rows(table_d_1(), 4, base)


def test_h_is_printed_exactly_and_l_goes_down_everywhere() -> None:
    row = {"F-02-02": FILTERS["F-02-02"]}
    assert reduce.rounded(row, "H") == {"F-02-02H": FILTERS["F-02-02H"]}
    low = reduce.rounded(row, "L")["F-02-02L"]
    assert all(a <= b and a % 8 == 0 for a, b in zip(low, FILTERS["F-02-02"], strict=True))
    # As printed, only these four of the layers that are no multiple go down.
    printed = dict(zip(LAYERS, FILTERS["F-02-02L"], strict=True))
    ours = dict(zip(LAYERS, low, strict=True))
    assert all(ours[layer] == printed[layer] for layer in (48, 40, 27, 8))
    assert reduce.rounded({"x": (5, 256)}, "L") == {"xL": (8, 256)}


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
    table = reduce.comparison_table("T", CARDS, {"original": 0.5, "B-01-01": 0.25}, "thesis")
    rows = {row[0]: row for row in table.rows}
    assert rows["B-01-01"][1:6] == ("90", "0.250", "2", "0.1100", "0.1400")
    assert table.records[1]["ssim_best"] == pytest.approx(0.89)  # the larger of the two
    # The reduced network's best, 0.11, is below the baseline's mean, 0.12, and beats nothing.
    assert rows["B-01-01"][-2:] == ("+0.0100", "+0.0200")
    assert rows["original"][-2:] == ("+0.0000", "+0.0000")
    # Without the baseline nothing is compared, and protocols are apart.
    assert reduce.comparison_table("T", CARDS[2:], {}, "thesis").rows[0][-2:] == ("–", "–")
    table = reduce.comparison_table("T", CARDS, {}, "thesis-networks-2")
    assert (table.records[1]["nrmse_mean"], table.rows[1][2]) == (pytest.approx(0.014), "–")
    assert table.rows[1][6:8] == ("–", "–")


def test_rows_are_those_of_the_folder_and_others_are_named(tmp_path: Path) -> None:
    for name in ("B-01-01", "original", "B-01-02"):
        (tmp_path / f"{name}.toml").write_text("")
    assert list(reduce.configurations_in(tmp_path, None)) == ["original", "B-01-01", "B-01-02"]
    assert list(reduce.configurations_in(tmp_path, ["B-01-02"])) == ["B-01-02"]
    with pytest.raises(UnknownNameError, match="B-01-02"):
        reduce.configurations_in(tmp_path, ["B-01-03"])
    with pytest.raises(InputError, match="lacks original"):
        reduce.configurations_in(tmp_path / "nowhere", None)
