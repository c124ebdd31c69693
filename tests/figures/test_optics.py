import numpy as np
import pytest

from dfdbench.figures.optics import blur_figure, pair_figure
from dfdbench.optics.lens_table import rank_pairs, read_lens_table
from dfdbench.optics.thin_lens import ThinLens


def test_blur_touches_nothing_at_the_focus_and_its_limit_far_off() -> None:
    lens = ThinLens(3.7, 9.6e-3, 0.5, 4.8e-6)
    axis = blur_figure(lens, 0.4, 4.0).axes[0]
    blur, quantised, limit, focus = axis.lines
    distance, pixels = np.asarray(blur.get_xdata()), np.asarray(blur.get_ydata())
    (highest, _) = np.asarray(limit.get_ydata())
    assert distance[np.argmin(pixels)] == pytest.approx(0.5, abs=1e-3)
    assert np.all(np.asarray(quantised.get_ydata()) == lens.quantised_blur_radius(distance))
    # Table 2.1: 10.58 pixels at infinity.
    assert highest == pytest.approx(10.58, abs=0.005)
    assert set(np.asarray(focus.get_xdata())) == {0.5}
    assert axis.get_title() == "f/3.7, 9.6 mm, focused at 0.5 m, pixels of 4.8 µm"
    assert axis.get_ylim()[1] > highest


def test_each_pair_has_its_steps_their_difference_and_the_range() -> None:
    table = read_lens_table()
    pairs = rank_pairs(table, 1.5, 2.2)[:3]
    figure = pair_figure(table, pairs)
    assert [axis.get_title() for axis in figure.axes] == [pair.name for pair in pairs]
    for axis, pair in zip(figure.axes, pairs, strict=True):
        first, second, difference = (np.asarray(line.get_ydata()) for line in axis.lines)
        assert np.array_equal(difference, np.abs(first - second))
        within = np.isin(table.distances, pair.distances)
        assert tuple(difference[within].astype(int)) == pair.differences
        left, right = axis.patches[0].get_extents().intervalx
        shown = axis.transData.inverted().transform([(left, 0), (right, 0)])[:, 0]
        assert shown == pytest.approx((pair.distances[0], pair.distances[-1]))
