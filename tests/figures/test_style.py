from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from dfdbench.figures import style


@given(levels=st.lists(st.floats(0, 255), min_size=1, max_size=20))
@settings(max_examples=30)
def test_all_depths_are_within_the_span_and_it_is_never_narrow(levels: list[float]) -> None:
    low, high = style.depth_span(np.array([np.nan, *levels]))
    assert low <= min(levels) <= max(levels) <= high
    assert high - low >= 20 - 1e-9
    if max(levels) - min(levels) >= 20:
        assert (low, high) == (min(levels), max(levels))


@pytest.mark.parametrize("text", ["$x$", "_hidden", "a$", "100 % _ $\\frac$", "two\nlines"])
def test_no_text_is_taken_for_a_formula_or_left_out_of_a_legend(tmp_path: Path, text: str) -> None:
    shown = style.plain_text(text)
    # Matplotlib hides what begins so, and sets what stands between dollars.
    assert not shown.startswith("_")
    assert "\n" not in shown
    assert shown.replace(r"\$", "$").strip() == " ".join(text.split("\n"))
    figure = Figure(figsize=(1, 1))
    figure.text(0, 0, shown)
    # What is no right formula cannot be drawn.
    style.write_figure(figure, tmp_path / "a.png")


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_a_figure_has_the_same_bytes_each_time(tmp_path: Path, suffix: str) -> None:
    written = []
    for _ in range(2):
        figure = Figure(figsize=(1, 1))
        figure.subplots().plot([1, 2], [3, 1], label="line")
        style.write_figure(figure, tmp_path / f"x{suffix}")
        written.append((tmp_path / f"x{suffix}").read_bytes())
    assert written[0] == written[1]
