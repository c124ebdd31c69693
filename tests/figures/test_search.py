from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

pytest.importorskip("torch", reason="needs the extra nets")

from dfdbench.figures.search import convergence_figure, objective_figure, widths_figure
from dfdbench.figures.style import write_figure
from dfdbench.methods.networks.choices import FILTERS, LAYERS
from dfdbench.training.search.course import Iteration

COURSE = [
    Iteration(0, 0.9, 0.9, 1.2, 0, 0.2),
    Iteration(1, 0.9, math.nan, math.nan, 6, 0.5),
    Iteration(2, 0.7, 0.7, 0.8, 1, 0.93),
]


def ydata(line: Line2D) -> list[float]:
    return [float(value) for value in np.asarray(line.get_ydata())]


def test_the_objective_is_drawn_with_its_best_and_mean(tmp_path: Path) -> None:
    figure = objective_figure(COURSE, "a $ swarm")
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert ydata(lines["best so far"]) == [0.9, 0.9, 0.7]
    assert [y for y in ydata(lines["mean"]) if y == y] == [1.2, 0.8]
    write_figure(figure, tmp_path / "a.png")


def test_convergence_has_the_author_s_marks() -> None:
    axis = convergence_figure(COURSE, "swarm").axes[0]
    assert ydata(axis.lines[0]) == pytest.approx([20, 50, 93])
    assert [ydata(line)[0] for line in axis.lines[1:]] == pytest.approx([90, 95, 99])
    assert [text.get_text() for text in axis.texts] == ["90 %", "95 %", "99 %"]


def test_widths_stand_beside_the_baseline_s() -> None:
    axis = widths_figure(FILTERS["pso"], "swarm").axes[0]
    heights = [patch.get_bbox().height for patch in axis.patches if isinstance(patch, Rectangle)]
    assert heights[: len(LAYERS)] == list(FILTERS["original"])
    assert heights[len(LAYERS) :] == list(FILTERS["pso"])
    assert [text.get_text() for text in axis.get_xticklabels()] == [str(n) for n in LAYERS]
