"""A metric is defined once, and whatever shows scores shows it."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from dfdbench.board.ranking import Entry, boards
from dfdbench.board.tables import lighting_table, standings_table
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import ResultError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.figures.comparisons import lighting_figures
from dfdbench.figures.runs import group_figures, panel_figure, score_figure
from dfdbench.metrics import metric
from dfdbench.metrics.metric import IN_METRES, METRICS, Metric
from dfdbench.metrics.protocol import PROTOCOLS, metrics_of
from dfdbench.metrics.scores import nmae
from dfdbench.report.page import write_html
from dfdbench.results.differences import change_tables
from dfdbench.results.record import RESULT, Result, load_result
from dfdbench.results.run_tables import run_tables, scene_tables, spread_table
from dfdbench.results.saved_run import open_saved_run
from dfdbench.results.summary import summarise
from tests.evaluation.made_predictions import in_metres

HEADING, TITLE = "MAE_LEVELS ↓", "MAE_LEVELS"


@pytest.fixture
def with_a_fourth(monkeypatch: pytest.MonkeyPatch) -> None:
    levels = Metric("mae_levels", False, nmae, 0, 255, data_range=1.0, younger=True)
    monkeypatch.setitem(metric._METRICS, levels.name, levels)


def shows_it(figure: Figure) -> bool:
    texts = [text for axis in figure.axes for text in (axis.get_xlabel(), axis.get_ylabel())]
    return any(TITLE in text for text in texts)


def run_constant(store: Dataset, folder: Path) -> Result:
    return run_method(store, load_for(store, "constant", {}), "all", folder).result


@pytest.mark.usefixtures("with_a_fourth")
def test_a_metric_more_is_in_every_table_figure_and_page(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    result = run_constant(tiny_store, folder)
    first = result.pairs[0].scores["valid"]
    assert first["mae_levels"] == pytest.approx(255 * (first["nmae"] or math.nan))
    assert load_result(folder) == result

    scenes = [
        scene.model_copy(update={"geometry": f"flat-{scene.name}", "texture": 0})
        for scene in tiny_store.manifest.scenes
    ]
    summary = summarise(result, "valid")
    scores, extremes, _ = run_tables(summary)
    (board,) = [b for b in boards([Entry.of(result, folder / RESULT)]) if b.protocol == "valid"]
    standings = standings_table(board, tmp_path)
    by_scene = scene_tables(summary, scenes)
    assert len(by_scene) == 2
    for table in (scores, extremes, spread_table(summary), *by_scene, standings):
        assert table.columns.count(HEADING) == 1
        assert all(len(row) == len(table.columns) == len(table.align) for row in table.rows)
    assert sorted({n for part in standings.parts for n in part}) == [*range(len(standings.columns))]
    assert standings.records[0]["mae_levels"] == (result.averages or {})["valid"]["mae_levels"]
    assert HEADING in {row[1] for row in lighting_table(board).rows}
    assert HEADING in {row[0] for row in change_tables(result, result, "valid")[0].rows}
    assert "mae_levels" in {row["metric"] for row in scores.records}
    assert extremes.records[0]["mae_levels"] == summary.ranked[0].score("valid", "mae_levels")

    run = open_saved_run(folder, str(tiny_store.path))
    drawn = score_figure(result, "valid")
    worst = panel_figure(tiny_store, result, folder, summary.ranked[:1], "valid", "worst")
    figures = [
        drawn,
        worst,
        *lighting_figures([run], "valid").values(),
        *group_figures({"constant": result}, "valid", scenes).values(),
    ]
    assert all(figure is not None and shows_it(figure) for figure in figures)
    page = write_html([run], "valid", tmp_path / "page").read_text("utf-8")
    assert f">{HEADING}</th>" in page
    assert f"<span>{TITLE} <b>" in page


@pytest.mark.usefixtures("with_a_fourth")
def test_a_metric_more_is_in_what_experiments_show() -> None:
    pytest.importorskip("torch", reason="needs the extra nets")
    from dfdbench.figures.trainings import experiment_figure, training_figure
    from dfdbench.training.experiments import experiment_table, find_experiment
    from dfdbench.training.trainer import Log
    from tests.methods.made_weights import card

    scores = {"nrmse": 0.2, "nmae": 0.1, "ssim": 0.9}
    cards = [("", card(seed=n, scores=scores | {"mae_levels": 20.0 + 10 * n})) for n in (0, 1)]
    table = experiment_table(find_experiment("repeatability"), cards)
    assert table.columns[-1] == HEADING
    assert len(table.columns) == len(table.align)
    assert table.rows[1][-1] == "25.0000"
    assert shows_it(experiment_figure("experiment", cards))
    losses = [{"step": "1", "loss": "2", "learning_rate": "1"}]
    log = Log(losses, [{"step": "1", "test_mae_levels": "20"}])
    assert shows_it(training_figure(log, "training"))


@pytest.mark.slow
def test_in_metres_every_table_figure_and_page_shows_their_metrics(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    store, _ = in_metres(tiny_store)
    folder = tmp_path / "run"
    result = run_constant(store, folder)
    assert load_result(folder) == result
    assert list(result.pairs[0].scores) == [*PROTOCOLS, "metric", "aligned"]
    headings = [each.heading for each in IN_METRES.values()]
    for protocol, wanted in (("metric", headings), ("aligned", [headings[0], *headings[2:]])):
        summary = summarise(result, protocol)
        assert len(summary.ranked) == len(result.pairs)
        found = boards([Entry.of(result, folder / RESULT)])
        (board,) = [each for each in found if each.protocol == protocol]
        scores, extremes, _ = run_tables(summary)
        for table in (scores, extremes, spread_table(summary), standings_table(board, tmp_path)):
            shown = [text for text in table.columns if text.endswith(("↑", "↓"))]
            assert shown == wanted, table.title
            assert all(len(row) == len(table.columns) == len(table.align) for row in table.rows)
        assert [row[1] for row in lighting_table(board).rows] == wanted
        changed = change_tables(result, result, protocol)[0]
        assert [row[0] for row in changed.rows if row[0]] == wanted
        assert extremes.records[0].keys() >= set(metrics_of(protocol))
        run = open_saved_run(folder, str(tiny_store.path))
        figures = [
            score_figure(result, protocol),
            panel_figure(store, result, folder, summary.ranked[:1], protocol, "worst"),
            *lighting_figures([run], protocol).values(),
            *group_figures({"constant": result}, protocol, []).values(),
        ]
        for figure in figures:
            assert figure is not None
            texts = [t for axis in figure.axes for t in (axis.get_xlabel(), axis.get_ylabel())]
            assert any("δ < 1.15" in text for text in texts)
            assert not any("NRMSE" in text for text in texts)
        page = write_html([run], protocol, tmp_path / protocol).read_text("utf-8")
        assert "<span>δ &lt; 1.25 <b>" in page
    assert [board.protocol for board in found][:1] == ["valid"], "the trio stays the headline"
    again = run_constant(tiny_store.__class__(tiny_store.path), tmp_path / "levels")
    assert list(again.pairs[0].scores) == list(PROTOCOLS)
    assert [protocol["name"] for protocol in again.protocols] == [
        "thesis",
        "thesis-networks",
        "valid",
    ]


def test_a_result_from_before_a_metric_is_shown_without_it(
    tiny_store: Dataset, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    run_constant(tiny_store, tmp_path / "run")
    request.getfixturevalue("with_a_fourth")
    result = load_result(tmp_path / "run")
    summary = summarise(result, "valid")
    assert summary.groups[-1].undefined == 0
    table = run_tables(summary)[0]
    place = table.columns.index(HEADING)
    assert {row[place] for row in table.rows} == {"–"}


@pytest.mark.parametrize("scores", [{"nrmse": 0.1, "nmae": 0.1}, {"other": 0.1}, {"ssim": 1.5}])
def test_scores_of_other_metrics_are_refused(
    tiny_store: Dataset, tmp_path: Path, scores: dict[str, float]
) -> None:
    run_constant(tiny_store, tmp_path / "run")
    content = json.loads((tmp_path / "run" / RESULT).read_text())
    there = content["pairs"][0]["scores"]
    there["valid"] = scores if "nrmse" in scores else there["valid"] | scores
    (tmp_path / "run" / RESULT).write_text(json.dumps(content))
    wrong = next(iter(scores.keys() - {"nrmse", "nmae"}), "ssim")
    with pytest.raises(ResultError, match=rf"pairs\[0\]\.scores\.valid\).*{wrong}"):
        load_result(tmp_path / "run")


def test_the_names_need_no_numba() -> None:
    code = (
        "import sys; from dfdbench.metrics.metric import METRICS; import dfdbench.results.summary; "
        "assert 'numba' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_each_function_keeps_to_its_bounds() -> None:
    depth = np.arange(400, dtype=np.uint8).reshape(20, 20)
    for each in METRICS.values():
        for test in (depth, 255 - depth, np.full_like(depth, 255)):
            score = each.function(depth, test, data_range=each.data_range, mask=None)
            assert each.lowest <= score <= each.highest
