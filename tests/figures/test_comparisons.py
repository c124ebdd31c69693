from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from dfdbench.figures import comparisons
from dfdbench.figures.style import plain_text
from dfdbench.results.saved_run import SavedRun
from tests.made_results import edited, limited, make_result

VALUES: dict[tuple[str, int, int, int], float | None] = {
    (scene, view, i, e): 0.1 for scene in "ab" for view in (1, 5) for i in (1, 2) for e in (0, 1)
}


def run(name: str) -> SavedRun:
    return SavedRun(Path("r.json"), make_result(VALUES, name), None, "none kept")


def means(**tracks: list[float]) -> pd.DataFrame:
    return pd.DataFrame.from_dict(tracks, orient="index")


def test_a_figure_an_illumination_with_each_metric_by_scene_and_exposure() -> None:
    figures = comparisons.lighting_figures([run("one"), run("two")], "thesis")
    assert list(figures) == ["illumination 1", "illumination 2"]
    axes = figures["illumination 1"].axes
    assert len(axes) == 6
    # Two methods a panel, in each two scenes from two views.
    assert [len(np.asarray(line.get_xdata())) for line in axes[0].get_lines()] == [4, 4]


def test_one_scene_is_one_figure_with_each_lighting_beside_the_other() -> None:
    one = {key: value for key, value in VALUES.items() if key[0] == "a"}
    runs = [SavedRun(Path("r.json"), make_result(one, name), None, "") for name in ("m", "n")]
    (figure,) = comparisons.lighting_figures(runs, "thesis").values()
    assert len(figure.axes) == 3
    line = figure.axes[0].get_lines()[0]
    assert sorted(np.asarray(line.get_ydata())) == pytest.approx(sorted(one.values()))


def test_one_exposure_alone_shows_every_method_in_a_legend_that_is_whole() -> None:
    one = {("a", 1, 1, 2): 0.1, ("b", 1, 1, 2): 0.2}
    names = ["constant", "graph-cuts, the recipe of the text and its offset", "x" * 150, r"\$" * 90]
    runs = [SavedRun(Path("r.json"), make_result(one, name), None, "") for name in names]
    figure = comparisons.lighting_figures(runs, "thesis")["illumination 1"]
    figure.draw_without_rendering()
    legend = figure.legends[0]
    shown = ["".join(text.get_text().split()) for text in legend.get_texts()]
    assert shown == [plain_text("".join(name.split())) for name in names]
    whole, frame = figure.bbox, legend.get_window_extent()
    assert whole.x0 <= frame.x0 < frame.x1 <= whole.x1
    assert whole.y0 <= frame.y0 < frame.y1 <= figure.axes[-1].bbox.y0


def test_times_are_boxes_and_nothing_run_is_no_figure() -> None:
    figure = comparisons.time_figure([run("one"), run("two")])
    assert figure is not None
    assert figure.axes[0].get_xscale() == "log"
    together = edited(make_result(VALUES), pairs={"timed_alone": False})
    assert comparisons.time_figure([SavedRun(Path("r.json"), together, None, "")]) is None
    saved = SavedRun(Path("r.json"), limited(make_result(VALUES), 0), None, "")
    assert comparisons.time_figure([saved]) is None
    assert comparisons.lighting_figures([saved], "thesis") == {}
    assert comparisons.accuracy_figure([saved], "thesis") is None


def test_accuracy_and_seconds_are_a_mark_a_method() -> None:
    figure = comparisons.accuracy_figure([run("one"), run("two")], "thesis")
    assert figure is not None
    (axis,) = figure.axes
    averages = run("one").result.averages
    assert averages is not None
    assert np.asarray(axis.lines[0].get_xydata()).tolist() == [[0.25, averages["thesis"]["nrmse"]]]


def test_each_track_has_a_panel_with_a_line_for_each_method() -> None:
    scores = {
        "mine": means(gain=[0.1, 0.2, 0.3, 0.4], noise=[0.1, 0.1, np.nan, 0.3]),
        "yours": means(gain=[0.2, 0.2, 0.2, 0.2]),
    }
    figure = comparisons.tracks_figure(scores, "nrmse", "on demo")
    panels = [axis for axis in figure.axes if axis.axison]
    assert [axis.get_title() for axis in panels] == ["gain", "noise"]
    first, second = panels[0].lines[:2]
    assert np.asarray(first.get_ydata()).tolist() == [0.1, 0.2, 0.3, 0.4]
    assert np.asarray(second.get_ydata()).tolist() == [0.2] * 4
    # A severity without a score is a gap, not a zero.
    assert np.isnan(np.asarray(panels[1].lines[0].get_ydata(), float)[2])
    one = comparisons.tracks_figure({"flat": means(gain=[0.2] * 4)}, "nrmse", "on demo, " * 12)
    assert one.axes[0].get_ylim()[1] >= 1.05 * 0.2
    title, width = one.get_suptitle(), one.get_figwidth()
    assert max(map(len, title.splitlines())) < 13 * width


def test_a_transfer_is_coloured_by_the_score_over_that_of_the_own_fit() -> None:
    matrix = pd.DataFrame([[0.1, 0.3], [0.4, 0.2]], ["a", "b"], ["a", "b"])
    axis = Figure().subplots()
    image = comparisons.draw_transfer(axis, matrix, most=4)
    assert np.asarray(image.get_array()).tolist() == pytest.approx(np.array([[1, 1.5], [4, 1]]))
    assert image.get_clim() == (1, 4)
    colours = {text.get_text(): text.get_color() for text in axis.texts}
    assert colours == {"0.100": "black", "0.300": "black", "0.400": "white", "0.200": "black"}
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("tested on", "fitted on")
    assert comparisons.transfer_figure(matrix, "A title").axes[0].images[0].get_clim() == (1, 4)
