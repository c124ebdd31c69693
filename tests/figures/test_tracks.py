"""A panel a track, a line a method, clean at severity 0."""

import numpy as np
import pandas as pd

from dfdbench.figures.tracks import tracks_figure


def means(**tracks: list[float]) -> pd.DataFrame:
    return pd.DataFrame.from_dict(tracks, orient="index")


def test_each_track_has_a_panel_with_a_line_for_each_method() -> None:
    scores = {
        "mine": means(gain=[0.1, 0.2, 0.3, 0.4], noise=[0.1, 0.1, np.nan, 0.3]),
        "yours": means(gain=[0.2, 0.2, 0.2, 0.2]),
    }
    figure = tracks_figure(scores, "nrmse", "on demo")
    panels = [axis for axis in figure.axes if axis.axison]
    assert [axis.get_title() for axis in panels] == ["gain", "noise"]
    first, second = panels[0].lines[:2]
    assert np.asarray(first.get_ydata()).tolist() == [0.1, 0.2, 0.3, 0.4]
    assert np.asarray(second.get_ydata()).tolist() == [0.2] * 4
    # A severity without a score is a gap, not a zero.
    assert np.isnan(np.asarray(panels[1].lines[0].get_ydata(), float)[2])
    assert [text.get_text() for text in panels[0].get_xticklabels()] == ["clean", "1", "2", "3"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["mine", "yours"]


def test_seven_tracks_stand_in_two_rows() -> None:
    scores = {"mine": means(**{f"track {number}": [0.1, 0.2] for number in range(7)})}
    figure = tracks_figure(scores, "nrmse", "on demo")
    assert sum(axis.axison for axis in figure.axes) == 7
    assert not figure.legends


def test_no_two_of_fifteen_methods_look_alike() -> None:
    scores = {f"method {number}": means(gain=[0.1, 0.2]) for number in range(15)}
    lines = tracks_figure(scores, "nrmse", "on demo").axes[0].lines
    looks = {(line.get_color(), line.get_marker(), line.get_linestyle()) for line in lines}
    assert len(looks) == 15


def test_no_score_lies_outside_its_panel() -> None:
    scores = {"mine": means(gain=[0.1, 0.2], camera=[0.1, 0.9])}
    figure = tracks_figure(scores, "nrmse", "on demo")
    for axis in figure.axes[:2]:
        low, high = axis.get_ylim()
        assert (low, high > 0.9) == (0, True)
