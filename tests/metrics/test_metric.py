"""A metric is defined once, and whatever shows scores shows it."""

import html
import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.board.ranking import boards
from dfdbench.board.tables import lighting_table, standings_table
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, ResultError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.figures.comparisons import lighting_figures
from dfdbench.figures.runs import group_figures, panel_figure, score_figure
from dfdbench.metrics import metric
from dfdbench.metrics.metric import abs_rel, aligned, boundary_f1, rmse_metres, share_within
from dfdbench.metrics.protocol import PROTOCOLS, metrics_of
from dfdbench.metrics.scores import nmae
from dfdbench.report.page import write_html
from dfdbench.results.differences import change_tables
from dfdbench.results.record import RESULT, Result, load_result
from dfdbench.results.run_tables import run_tables, scene_tables, spread_table
from dfdbench.results.saved_run import open_saved_run
from dfdbench.results.summary import summarise
from tests.board.made_boards import entry_of
from tests.evaluation.made_predictions import in_metres
from tests.made_results import make_result

HEADING, TITLE = "MAE_LEVELS ↓", "MAE_LEVELS"


@pytest.fixture
def with_a_fourth(monkeypatch: pytest.MonkeyPatch) -> None:
    levels = metric.Metric("mae_levels", False, nmae, 0, 255, data_range=1.0, younger=True)
    monkeypatch.setitem(metric._METRICS, levels.name, levels)


def labels_of(figure: Figure | None) -> str:
    """The labels as they are read, wherever a caption is wrapped."""
    assert figure is not None
    labels = (f"{axis.get_xlabel()} {axis.get_ylabel()}" for axis in figure.axes)
    return " ".join(" ".join(labels).split())


def run_constant(store: Dataset, folder: Path) -> Result:
    result = run_method(store, load_for(store, "constant", {}), "all", folder).result
    assert load_result(folder) == result
    return result


def check_shown(store: Dataset, result: Result, folder: Path, protocol: str) -> None:
    """Assert that each table, figure and page of a run shows the metrics of a protocol."""
    wanted = [each.heading for each in metrics_of(protocol).values()]
    titles = [each.title for each in metrics_of(protocol).values()]
    scenes = [
        scene.model_copy(update={"geometry": f"flat-{scene.name}", "texture": 0})
        for scene in store.manifest.scenes
    ]
    summary = summarise(result, protocol)
    assert len(summary.ranked) == len(result.pairs)
    (board,) = [b for b in boards([entry_of(result, folder / RESULT)]) if b.protocol == protocol]
    standings = standings_table(board, folder)
    scores, extremes, _ = run_tables(summary)
    by_scene = scene_tables(summary, scenes)
    assert len(by_scene) == 2
    for table in (scores, extremes, spread_table(summary), *by_scene, standings):
        assert [text for text in table.columns if text.endswith(("↑", "↓"))] == wanted, table.title
        assert all(len(row) == len(table.columns) == len(table.align) for row in table.rows)
    assert sorted({n for part in standings.parts for n in part}) == [*range(len(standings.columns))]
    assert [row[1] for row in lighting_table(board).rows] == wanted
    changed = change_tables(result, result, protocol)[0]
    assert [row[0] for row in changed.rows if row[0]] == wanted
    for name in metrics_of(protocol):
        assert standings.records[0][name] == (result.averages or {})[protocol][name]
        assert extremes.records[0][name] == summary.ranked[0].score(protocol, name)

    run = open_saved_run(folder, str(store.path))
    for figure in (
        score_figure(result, protocol),
        panel_figure(store, result, folder, summary.ranked[:1], protocol, "worst"),
        *lighting_figures([run], protocol).values(),
        *group_figures({"constant": result}, protocol, scenes).values(),
    ):
        labels = labels_of(figure)
        assert all(title in labels for title in (titles[0], titles[-1]))
        assert ("NRMSE" in labels) == ("NRMSE" in titles)
    page = write_html([run], protocol, folder.with_name(protocol)).read_text("utf-8")
    assert all(f"<span>{html.escape(title)} <b>" in page for title in titles)


@pytest.mark.usefixtures("with_a_fourth")
def test_one_metric_more_is_in_every_table_and_page(tiny_store: Dataset, tmp_path: Path) -> None:
    result = run_constant(tiny_store, tmp_path / "run")
    first = result.pairs[0].scores["valid"]
    assert first["mae_levels"] == pytest.approx(255 * (first["nmae"] or math.nan))
    check_shown(tiny_store, result, tmp_path / "run", "valid")


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
    assert TITLE in labels_of(experiment_figure("experiment", cards))
    losses = [{"step": "1", "loss": "2", "learning_rate": "1"}]
    log = Log(losses, [{"step": "1", "test_mae_levels": "20"}])
    assert TITLE in labels_of(training_figure(log, "training"))


@pytest.mark.slow
def test_in_metres_all_tables_and_pages_show_them(tiny_store: Dataset, tmp_path: Path) -> None:
    plain = run_constant(tiny_store, tmp_path / "levels")
    assert list(plain.pairs[0].scores) == list(PROTOCOLS)
    store, _ = in_metres(tiny_store)
    result = run_constant(store, tmp_path / "run")
    assert list(result.pairs[0].scores) == [*PROTOCOLS, "metric", "aligned"]
    for protocol in ("metric", "aligned"):
        check_shown(store, result, tmp_path / "run", protocol)
    found = boards([entry_of(result, tmp_path / "run" / RESULT)])
    assert found[0].protocol == "valid", "the trio stays the headline"


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


def test_scores_of_other_metrics_are_refused(tmp_path: Path) -> None:
    content = make_result({("a", 1, 1, 0): 0.1}).model_dump(mode="json")
    scores = content["pairs"][0]["scores"]["thesis"]
    for wrong in (scores | {"other": 0.1}, scores | {"ssim": 1.5}, {"nrmse": 0.1, "nmae": 0.1}):
        content["pairs"][0]["scores"]["thesis"] = wrong
        (tmp_path / RESULT).write_text(json.dumps(content))
        said = "other" if "other" in wrong else "ssim"
        with pytest.raises(ResultError, match=rf"pairs\[0\]\.scores\.thesis\).*{said}"):
            load_result(tmp_path)


def test_each_function_keeps_to_its_bounds() -> None:
    depth = np.arange(400, dtype=np.uint8).reshape(20, 20)
    for each in metric.METRICS.values():
        for test in (depth, 255 - depth, np.full_like(depth, 255)):
            score = each.function(depth, test, data_range=each.data_range, mask=None)
            assert each.lowest <= score <= each.highest


Floats = NDArray[np.float64]
SHAPE = (5, 7)
metres = hnp.arrays(np.float64, SHAPE, elements=st.floats(0.125, 64, width=32))
masks = hnp.arrays(np.bool_, SHAPE)


def test_values_by_hand() -> None:
    truth = np.array([[1.0, 2.0], [4.0, 8.0]])
    test = np.array([[1.5, 2.0], [3.0, 16.0]])
    # 0.5 / 1, 0, 1 / 4, 8 / 8.
    assert abs_rel(truth, test) == pytest.approx(1.75 / 4)
    assert rmse_metres(truth, test) == pytest.approx(math.sqrt((0.25 + 0 + 1 + 64) / 4))
    # Ratios 1.5, 1, 4 / 3 and 2, against 1.25, 1.5625 and 1.953125.
    assert share_within(truth, test) == 0.25
    assert share_within(truth, test, factor=1.25**2) == 0.75
    assert share_within(truth, test, factor=1.25**3) == 0.75
    mask = np.array([[True, False], [True, False]])
    assert abs_rel(truth, test, mask=mask) == pytest.approx(0.375)
    assert rmse_metres(truth, test, mask=mask) == pytest.approx(math.sqrt(0.625))
    assert share_within(truth, test, mask=mask, factor=1.4) == 0.5


def test_boundaries_by_hand() -> None:
    # One of two edges found, at every threshold.
    assert boundary_f1([[1.0, 2.0, 2.0, 4.0]], [[1.0, 2.0, 2.0, 2.0]]) == pytest.approx(2 / 3)
    # A step of 1.1 is an edge at the three lowest thresholds; each weighs what it is.
    low = (1.05 + 1.07222 + 1.09444) / (10 * 1.15)
    assert boundary_f1([[1.0, 2.0]], [[1.0, 1.1]]) == pytest.approx(low, abs=1e-5)
    # A step of a threshold is no edge at it.
    assert boundary_f1([[1.0, 2.0]], [[1.0, 1.05]]) == 0
    assert math.isnan(boundary_f1([[1.0, 1.05]], [[1.0, 2.0]]))


def test_inverse_depth_at_or_below_zero_is_the_farthest_and_a_flat_map_the_mean() -> None:
    # A scale of 1 and a shift of -1 from the two known pixels: the third comes to -0.5, the
    # fourth to 0.05, beyond 10 m.
    truth = 1 / np.array([[1.0, 2.0, 1.0, 1.0]])
    test = 1 / np.array([[2.0, 3.0, 0.5, 1.05]])
    mask = np.array([[True, True, False, False]])
    np.testing.assert_allclose(aligned(truth, test, 10.0, mask), [[1.0, 0.5, 10.0, 10.0]])

    truth = 1 / np.array([[1.0, 2.0, 6.0]])
    for level in (0.3, 1 / 3, 7.0):
        np.testing.assert_allclose(aligned(truth, np.full((1, 3), level), 10.0), 1 / 3)


@given(truth=metres, test=metres, factor=st.sampled_from([0.25, 2.0, 8.0]))
def test_delta_is_the_same_both_ways_and_relative_errors_know_no_unit_but_rmse(
    truth: Floats, test: Floats, factor: float
) -> None:
    shares = [share_within(truth, test, factor=1.25**power) for power in (1, 2, 3)]
    assert shares == sorted(shares)
    assert shares == [share_within(test, truth, factor=1.25**power) for power in (1, 2, 3)]
    assert share_within(truth * factor, test * factor) == share_within(truth, test)
    assert abs_rel(truth * factor, test * factor) == pytest.approx(abs_rel(truth, test))
    larger = rmse_metres(truth * factor, test * factor)
    assert larger == pytest.approx(factor * rmse_metres(truth, test))


@given(truth=metres, test=metres, mask=masks)
def test_what_is_left_out_does_not_count(
    truth: Floats, test: Floats, mask: NDArray[np.bool_]
) -> None:
    assume(mask.any())
    assert abs_rel(truth, truth, mask=mask) == rmse_metres(truth, truth, mask=mask) == 0
    other = np.where(mask, test, 1.0)
    for measure in (abs_rel, rmse_metres, share_within):
        assert measure(truth, test, mask=mask) == measure(truth, other, mask=mask)
    np.testing.assert_array_equal(
        aligned(truth, test, 64.0, mask)[mask], aligned(truth, other, 64.0, mask)[mask]
    )


@given(truth=metres, test=metres)
def test_aligned_distances_are_distances_and_no_other_scale_and_shift_fits_better(
    truth: Floats, test: Floats
) -> None:
    found = aligned(truth, test, 64.0)
    assert np.isfinite(found).all()
    assert 0 < found.min() <= found.max() <= 64 * (1 + 1e-12)
    # Where no pixel is held at the farthest, which is made all but unreachable here.
    assume(np.ptp(1 / test) > 1e-3)
    found = 1 / aligned(truth, test, 1e30)
    assume(found.min() > 1e-12)
    left = float(np.sum((found - 1 / truth) ** 2))
    rows = np.stack([1 / test.ravel(), np.ones(test.size)], axis=1)
    best = rows @ np.linalg.lstsq(rows, 1 / truth.ravel(), rcond=None)[0]
    assert left <= float(np.sum((best - 1 / truth.ravel()) ** 2)) * (1 + 1e-9) + 1e-9


@given(truth=metres, scale=st.floats(0.25, 4), shift=st.floats(0, 2))
def test_alignment_undoes_scale_and_shift(truth: Floats, scale: float, shift: float) -> None:
    assume(np.ptp(1 / truth) > 1e-3)
    moved = 1 / (scale / truth + shift)
    np.testing.assert_allclose(aligned(truth, moved, 64.0), truth, rtol=1e-5)


def test_no_pixel_is_undefined() -> None:
    nothing = np.zeros((1, 2), bool)
    for measure in (abs_rel, rmse_metres, share_within):
        assert math.isnan(measure([[1.0, 2.0]], [[1.0, 2.0]], mask=nothing))
    assert aligned([[1.0, 2.0]], [[3.0, 4.0]], 9.0, nothing).tolist() == [[3.0, 4.0]]


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_what_is_no_distance_is_refused(bad: float) -> None:
    for measure in (abs_rel, rmse_metres, share_within):
        with pytest.raises(InputError, match=r"no distance|not finite"):
            measure([[1.0, 2.0]], [[bad, 2.0]])
    with pytest.raises(InputError, match="farthest"):
        aligned([[1.0, 2.0]], [[1.0, 2.0]], bad)
