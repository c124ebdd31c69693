"""A metric is defined once, and whatever shows scores shows it."""

import math
from collections.abc import Iterator
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
from dfdbench.datasets.manifest import Scene
from dfdbench.errors import InputError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.figures.comparisons import lighting_figures
from dfdbench.figures.runs import group_figures, panel_figure, score_figure
from dfdbench.metrics import metric
from dfdbench.metrics.metric import (
    IN_METRES,
    METRICS,
    Metric,
    abs_rel,
    aligned,
    boundary_f1,
    rmse_metres,
    share_within,
)
from dfdbench.metrics.protocol import PROTOCOLS, metrics_of
from dfdbench.metrics.scores import nmae
from dfdbench.report.page import write_html
from dfdbench.results.differences import change_tables
from dfdbench.results.record import RESULT, Result, load_result
from dfdbench.results.run_tables import all_tables, scene_tables
from dfdbench.results.saved_run import open_saved_run
from dfdbench.results.summary import summarise
from tests.board.made_boards import entry_of
from tests.evaluation.made_predictions import in_metres

HEADING, TITLE = "MAE_LEVELS ↓", "MAE_LEVELS"


@pytest.fixture
def with_a_fourth(monkeypatch: pytest.MonkeyPatch) -> None:
    levels = Metric("mae_levels", False, nmae, 0, 255, data_range=1.0, younger=True)
    monkeypatch.setitem(metric.METRICS, levels.name, levels)


def labels_of(figure: Figure | None) -> str:
    """The labels as they are read, wherever a caption is wrapped."""
    assert figure is not None
    labels = (f"{axis.get_xlabel()} {axis.get_ylabel()}" for axis in figure.axes)
    return " ".join(" ".join(labels).split())


def figures_of(
    store: Dataset, folder: Path, protocol: str, scenes: list[Scene]
) -> Iterator[Figure | None]:
    run = open_saved_run(folder, str(store.path))
    ranked = summarise(run.result, protocol).ranked[:1]
    yield score_figure(run.result, protocol)
    yield panel_figure(run, ranked, protocol, "worst")
    yield from lighting_figures([run], protocol).values()
    yield from group_figures({"constant": run.result}, protocol, scenes).values()


def run_constant(store: Dataset, folder: Path) -> Result:
    return run_method(store, load_for(store, "constant", {}), "all", folder).result


@pytest.mark.slow
@pytest.mark.usefixtures("with_a_fourth")
def test_one_metric_more_is_in_every_table_and_page(tiny_store: Dataset, tmp_path: Path) -> None:
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
    scores, extremes, _, spread = all_tables(summary, None)
    (board,) = [b for b in boards([entry_of(result, folder / RESULT)]) if b.protocol == "valid"]
    standings = standings_table(board, tmp_path)
    by_scene = scene_tables(summary, scenes)
    assert len(by_scene) == 2
    for table in (scores, extremes, spread, *by_scene, standings):
        assert table.columns.count(HEADING) == 1
        assert all(len(row) == len(table.columns) == len(table.align) for row in table.rows)
    assert sorted({n for part in standings.parts for n in part}) == [*range(len(standings.columns))]
    assert standings.records[0]["mae_levels"] == (result.averages or {})["valid"]["mae_levels"]
    assert HEADING in {row[1] for row in lighting_table(board).rows}
    assert HEADING in {row[0] for row in change_tables(result, result, "valid")[0].rows}
    assert "mae_levels" in {row["metric"] for row in scores.records}
    assert extremes.records[0]["mae_levels"] == summary.ranked[0].score("valid", "mae_levels")

    figures = figures_of(tiny_store, folder, "valid", scenes)
    assert all(TITLE in labels_of(figure) for figure in figures)
    run = open_saved_run(folder, str(tiny_store.path))
    page = write_html([run], "valid", tmp_path / "page").read_text("utf-8")
    assert f">{HEADING}</th>" in page
    assert f"<span>{TITLE} <b>" in page


@pytest.mark.slow
def test_in_metres_all_tables_and_pages_show_them(tiny_store: Dataset, tmp_path: Path) -> None:
    store, _ = in_metres(tiny_store)
    folder = tmp_path / "run"
    result = run_constant(store, folder)
    assert load_result(folder) == result
    assert list(result.pairs[0].scores) == [*PROTOCOLS, "metric", "aligned"]
    headings = [each.heading for each in IN_METRES.values()]
    for protocol, wanted in (("metric", headings), ("aligned", [headings[0], *headings[2:]])):
        summary = summarise(result, protocol)
        assert len(summary.ranked) == len(result.pairs)
        found = boards([entry_of(result, folder / RESULT)])
        (board,) = [each for each in found if each.protocol == protocol]
        scores, extremes, _, spread = all_tables(summary, None)
        for table in (scores, extremes, spread, standings_table(board, tmp_path)):
            shown = [text for text in table.columns if text.endswith(("↑", "↓"))]
            assert shown == wanted, table.title
            assert all(len(row) == len(table.columns) == len(table.align) for row in table.rows)
        assert [row[1] for row in lighting_table(board).rows] == wanted
        changed = change_tables(result, result, protocol)[0]
        assert [row[0] for row in changed.rows if row[0]] == wanted
        assert extremes.records[0].keys() >= set(metrics_of(protocol))
        for figure in figures_of(store, folder, protocol, []):
            assert "δ < 1.15" in labels_of(figure)
            assert "NRMSE" not in labels_of(figure)
        run = open_saved_run(folder, str(tiny_store.path))
        page = write_html([run], protocol, tmp_path / protocol).read_text("utf-8")
        assert "<span>δ &lt; 1.25 <b>" in page
    assert [board.protocol for board in found][:1] == ["valid"], "the trio stays the headline"
    again = run_constant(tiny_store.__class__(tiny_store.path), tmp_path / "levels")
    assert list(again.pairs[0].scores) == list(PROTOCOLS)
    names = [protocol["name"] for protocol in again.protocols]
    assert names == ["thesis", "thesis-networks", "valid"]


def test_a_result_from_before_a_metric_is_shown_without_it(
    tiny_store: Dataset, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    run_constant(tiny_store, tmp_path / "run")
    request.getfixturevalue("with_a_fourth")
    result = load_result(tmp_path / "run")
    summary = summarise(result, "valid")
    assert summary.groups[-1].undefined == 0
    table = all_tables(summary, None)[0]
    place = table.columns.index(HEADING)
    assert {row[place] for row in table.rows} == {"–"}


def test_each_function_keeps_to_its_bounds() -> None:
    depth = np.arange(400, dtype=np.uint8).reshape(20, 20)
    for each in METRICS.values():
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


def test_alignment_by_hand() -> None:
    # Inverse depths 1, 2, 3 and, estimated, 0, 0 and 3 of a unit, plus 1: means 2 and 2. The
    # scale is (-1 * -1 + 0 * -1 + 1 * 2) / (1 + 1 + 4) = 1 / 2.
    truth = 1 / np.array([[1.0, 2.0, 3.0]])
    test = 1 / np.array([[1.0, 1.0, 4.0]])
    np.testing.assert_allclose(1 / aligned(truth, test, 100.0), [[1.5, 1.5, 3.0]])


def test_inverse_depth_at_zero_or_below_counts_as_the_farthest() -> None:
    # A scale of 1 and a shift of -1 from the two known pixels: the third comes to -0.5, the
    # fourth to 0.05, beyond 10 m.
    truth = 1 / np.array([[1.0, 2.0, 1.0, 1.0]])
    test = 1 / np.array([[2.0, 3.0, 0.5, 1.05]])
    mask = np.array([[True, True, False, False]])
    np.testing.assert_allclose(aligned(truth, test, 10.0, mask), [[1.0, 0.5, 10.0, 10.0]])


def test_a_flat_estimate_becomes_the_mean_of_the_inverse_truth() -> None:
    truth = 1 / np.array([[1.0, 2.0, 6.0]])
    for level in (0.3, 1 / 3, 7.0):
        np.testing.assert_allclose(aligned(truth, np.full((1, 3), level), 10.0), 1 / 3)


def test_a_map_that_goes_the_wrong_way_is_turned() -> None:
    truth = 1 / np.array([[1.0, 2.0, 4.0]])
    np.testing.assert_allclose(aligned(truth, 1 / (5 - 1 / truth), 10.0), truth)


@given(truth=metres, mask=masks)
def test_the_truth_itself_is_perfect(truth: Floats, mask: NDArray[np.bool_]) -> None:
    assume(mask.any())
    assert abs_rel(truth, truth, mask=mask) == rmse_metres(truth, truth, mask=mask) == 0
    assert share_within(truth, truth, mask=mask) == 1


@given(truth=metres, test=metres)
def test_delta_is_the_same_both_ways_and_grows_with_its_bound(truth: Floats, test: Floats) -> None:
    shares = [share_within(truth, test, factor=1.25**power) for power in (1, 2, 3)]
    assert shares == sorted(shares)
    assert shares == [share_within(test, truth, factor=1.25**power) for power in (1, 2, 3)]


@given(truth=metres, test=metres, factor=st.sampled_from([0.25, 2.0, 8.0]))
def test_relative_errors_know_no_unit_but_rmse(truth: Floats, test: Floats, factor: float) -> None:
    assert abs_rel(truth * factor, test * factor) == pytest.approx(abs_rel(truth, test))
    assert share_within(truth * factor, test * factor) == share_within(truth, test)
    larger = rmse_metres(truth * factor, test * factor)
    assert larger == pytest.approx(factor * rmse_metres(truth, test))


@given(truth=metres, test=metres, mask=masks)
def test_what_is_left_out_does_not_count(
    truth: Floats, test: Floats, mask: NDArray[np.bool_]
) -> None:
    assume(mask.any())
    other = np.where(mask, test, 1.0)
    for measure in (abs_rel, rmse_metres, share_within):
        assert measure(truth, test, mask=mask) == measure(truth, other, mask=mask)
    np.testing.assert_array_equal(
        aligned(truth, test, 64.0, mask)[mask], aligned(truth, other, 64.0, mask)[mask]
    )


@given(truth=metres, test=metres)
def test_no_other_scale_and_shift_fits_better(truth: Floats, test: Floats) -> None:
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


@given(truth=metres, test=metres)
def test_aligned_distances_are_distances(truth: Floats, test: Floats) -> None:
    found = aligned(truth, test, 64.0)
    assert np.isfinite(found).all()
    assert (found > 0).all()
    assert found.max() <= 64 * (1 + 1e-12)


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
