import math

import numpy as np
import pytest
from matplotlib.lines import Line2D

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.figures import trainings
from dfdbench.training.crops import Selections
from dfdbench.training.search.swarm_search import Iteration
from dfdbench.training.trainer import Log
from tests.methods.made_weights import card


def heights(line: Line2D) -> list[float]:
    return [float(value) for value in np.asarray(line.get_ydata(), float)]


def test_losses_rates_and_scores_are_drawn_by_step() -> None:
    losses = [{"step": step, "learning_rate": 0.1, "loss": 5 / step} for step in range(1, 900)]
    scores = [{"step": step, "train_nmae": 0.1, "test_nmae": 0.2} for step in (300, 600)]
    axes = trainings.training_figure(Log(losses, scores), "title").axes
    loss = heights(axes[0].lines[0])
    assert len(loss) == 449
    assert loss[0] == pytest.approx((5 + 2.5) / 2)
    nmae = {line.get_label(): heights(line) for line in axes[3].lines}
    assert nmae == {"train pairs": [0.1, 0.1], "test pairs": [0.2, 0.2]}
    assert all(heights(line) == [] for line in axes[4].lines)


def test_levels_are_shares_of_their_pixels() -> None:
    rows = [
        {"level": str(level), "trained": "30" if level == 7 else "0", "present": "1"}
        for level in range(256)
    ]
    present, trained = trainings.levels_figure(rows, "title").axes[0].patches
    assert max(trained.get_data().values) == 100  # type: ignore[attr-defined]
    assert max(present.get_data().values) == pytest.approx(100 / 256)  # type: ignore[attr-defined]


def test_patches_are_drawn_by_pair_and_by_pixel_of_the_least_and_the_most() -> None:
    places = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 1], [2, 1, 1], [1, 0, 0], [1, 1, 0]], np.int32)
    drawn = Selections(("a", "b", "c"), ((4, 5),) * 3, 2, places)
    figure = trainings.patches_figure(drawn, "title")
    bars, *maps = [axis for axis in figure.axes if axis.get_title()]
    assert bars.patches[0].get_data().values.tolist() == [1, 2, 3]  # type: ignore[attr-defined]
    assert np.asarray(maps[2].images[0].get_array())[1, 1] == 3
    alone = Selections(("a",), ((4, 5),), 2, places[:1])
    assert len(trainings.patches_figure(alone, "title").axes) == 3


def test_an_experiment_shows_the_spread_of_values_and_the_baselines_as_a_band() -> None:
    cards = [
        (value, card(seed=seed, scores={"nrmse": score, "nmae": score, "ssim": score}))
        for value, seed, score in (("0", 0, 0.1), ("0", 1, 0.3), ("3", 0, 0.5))
    ]
    axis = trainings.experiment_figure("title", cards, "0").axes[0]
    drawn = {str(line.get_label()): heights(line) for line in axis.lines}
    assert drawn["mean of 0"] == pytest.approx([0.2, 0.2])
    assert drawn["minimum, maximum"] == [0.1, 0.3]
    assert heights(axis.lines[-1]) == [0.5]
    (band,) = axis.patches
    deviation = 2 * np.std([0.1, 0.3], ddof=1)
    low, high = band.get_extents().transformed(axis.transData.inverted()).intervaly
    assert (low, high) == pytest.approx((0.2 - deviation, 0.2 + deviation))
    assert not trainings.experiment_figure("title", cards, "3").axes[0].patches
    # Seeds alone are drawn one by one.
    alone = [("", each) for _, each in cards]
    assert heights(trainings.experiment_figure("title", alone).axes[0].lines[-1]) == [0.1, 0.3, 0.5]


COURSE = [
    Iteration(0, 0.9, 0.9, 1.2, 0, 0.2),
    Iteration(1, 0.9, math.nan, math.nan, 6, 0.5),
    Iteration(2, 0.7, 0.7, 0.8, 1, 0.93),
]


def test_a_swarm_s_best_and_mean_and_how_near_it_is_are_drawn() -> None:
    figure = trainings.objective_figure(COURSE, "a $ swarm")
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert heights(lines["best so far"]) == [0.9, 0.9, 0.7]
    assert [y for y in heights(lines["mean"]) if y == y] == [1.2, 0.8]
    axis = trainings.convergence_figure(COURSE, "swarm").axes[0]
    assert heights(axis.lines[0]) == pytest.approx([20, 50, 93])
    # The author's marks.
    assert [heights(line)[0] for line in axis.lines[1:]] == pytest.approx([90, 95, 99])
