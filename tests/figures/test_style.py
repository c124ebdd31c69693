from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from dfdbench.figures.style import (
    COLOURS,
    MARKERS,
    depth_span,
    legend_below,
    plain_text,
    without_ticks,
    wrapped,
    write_figure,
)


@given(levels=st.lists(st.floats(0, 255), min_size=1, max_size=20))
@settings(max_examples=30)
def test_all_depths_are_within_the_span_and_it_is_never_narrow(levels: list[float]) -> None:
    low, high = depth_span(np.array([np.nan, *levels]))
    assert low <= min(levels) <= max(levels) <= high
    assert high - low >= 20 - 1e-9
    if max(levels) - min(levels) >= 20:
        assert (low, high) == (min(levels), max(levels))


@pytest.mark.parametrize("text", ["$x$", "_hidden", "a$", "100 % _ $\\frac$", "two\nlines"])
def test_no_text_is_taken_for_a_formula_or_left_out_of_a_legend(tmp_path: Path, text: str) -> None:
    shown = plain_text(text)
    # Matplotlib hides what begins so, and sets what stands between dollars.
    assert not shown.startswith("_")
    assert "\n" not in shown
    assert shown.replace(r"\$", "$").strip() == " ".join(text.split("\n"))
    figure = Figure(figsize=(1, 1))
    figure.text(0, 0, shown)
    # What is no right formula cannot be drawn.
    write_figure(figure, tmp_path / "a.png")


@given(text=st.text("ab $_=", max_size=80), width=st.integers(8, 30))
@settings(max_examples=30)
def test_lines_are_no_longer_than_asked_but_for_a_dollars_backslash(text: str, width: int) -> None:
    plain = plain_text(text)
    for line in wrapped(plain, width).split("\n"):
        assert len(line.replace(r"\$", "$")) <= max(width, 1) or not line.strip()
    assert wrapped(plain, width).replace("\n", "").replace(" ", "") == plain.replace(" ", "")


def test_a_legend_of_long_names_makes_the_figure_larger_and_stays_within_it(tmp_path: Path) -> None:
    figure = Figure(figsize=(4, 3), layout="constrained")
    axis = figure.subplots()
    for number in range(7):
        axis.plot([0, 1], [number, 0], label=f"graph-cuts (window={number}, recipe=mine.toml)")
    legend_below(figure, axis)
    write_figure(figure, tmp_path / "legend.png")
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert figure.get_figwidth() > 4 or figure.get_figheight() > 3
    assert box.x0 >= 0
    assert box.x1 <= figure.get_figwidth() * figure.dpi + 1
    assert len(legend.get_texts()) == 7


def test_every_figure_is_as_fine(tmp_path: Path) -> None:
    write_figure(Figure(figsize=(3, 2)), tmp_path / "a.png")
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image is not None
    assert image.shape[:2] == (240, 360)


def test_bare_axes_show_their_background() -> None:
    figure = Figure()
    axes = figure.subplots(1, 2)
    without_ticks(axes, "0.75")
    for axis in axes:
        assert len(axis.get_xticks()) == len(axis.get_yticks()) == 0
        assert axis.get_facecolor() == (0.75, 0.75, 0.75, 1.0)


def test_colours_and_markers_tell_as_many_apart() -> None:
    assert len(set(COLOURS)) == len(set(MARKERS)) == len(COLOURS) == len(MARKERS)
