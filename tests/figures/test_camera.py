import numpy as np
import pytest

from dfdbench.blur.law import BlurLaw
from dfdbench.figures import camera
from dfdbench.methods.measured_law import Calibration
from dfdbench.optics.lens_table import rank_pairs, read_lens_table
from dfdbench.optics.sharpness import Measurement
from dfdbench.optics.thin_lens import ThinLens


def test_the_law_sets_the_scale_and_levels_without_pixels_have_no_dot() -> None:
    measured = np.full(256, np.nan)
    measured[10:20] = 90.0  # levels that showed no blur
    pixels = np.where(np.isnan(measured), 0, 50)
    law = BlurLaw(tuple(np.linspace(3, 1, 256).tolist()), exponent=8.0, linear=True)
    widths, left = camera.law_figure(Calibration(law, measured, pixels, measured)).axes
    assert widths.get_ylim() == (0, 1.3 * 3)
    assert "p = 8; linear light" in widths.get_title()
    assert np.isfinite(np.asarray(left.lines[0].get_ydata())).sum() == 10


def test_a_law_shows_how_the_view_and_the_light_change() -> None:
    curves = ((1.0, 0.9, 0.8), (1.0, 0.9, 0.75), (1.0, 0.8, 0.7))
    law = BlurLaw((3.0, 1.0), similarity=(0, 0, 0, 0.006), falloff=curves)
    figure = camera.law_figure(Calibration(law, np.ones(2), np.ones(2, int), np.ones(2)))
    assert "0.60 % larger; 25 % darker" in figure.axes[0].get_title()
    assert [np.asarray(line.get_ydata())[-1] for line in figure.axes[2].lines] == [0.8, 0.75, 0.7]


def measured(step: int, sharpness: float, temperature: float = 40.0) -> Measurement:
    return Measurement(step, temperature, sharpness, sharpness / 2)


def test_depth_maps_lie_over_one_image_on_one_scale() -> None:
    image = np.full((20, 30, 3), 90, np.uint8)
    levels = np.linspace(50, 200, 600).reshape(20, 30).astype(np.uint8)
    valid = levels > 80
    maps = dict.fromkeys(("parallel", "turned"), (levels, valid))
    panels = camera.overlay_figure(image, maps, "k33").axes[:2]
    assert [axis.get_title() for axis in panels] == ["parallel", "turned"]
    scales = {axis.images[1].get_clim() for axis in panels}
    assert scales == {(float(levels[valid].min()), 200.0)}
    below, above = (np.asarray(image.get_array()) for image in panels[1].images)
    assert np.array_equal(np.isnan(above), ~valid)
    # A dark image is drawn brighter.
    assert below.max() == 1


def test_sharpness_is_drawn_over_temperature_and_each_way_through_the_steps() -> None:
    figure = camera.temperature_figure([measured(135, 0.2, 30), measured(135, 0.4, 50)])
    sharpness, background = figure.axes[0].lines
    assert np.array_equal(sharpness.get_xydata(), [[30, 0.2], [50, 0.4]])
    assert np.array_equal(background.get_ydata(), [0.1, 0.2])
    assert "voltage step 135" in figure.axes[0].get_title()
    up = [measured(127, 0.1), measured(143, 0.3)]
    down = [measured(127, 0.2), measured(143, 0.4)]
    labels = [line.get_label() for line in camera.voltage_figure(up, down).axes[0].lines]
    assert labels == ["127 → 143", "143 → 127"]


def test_blur_touches_nothing_at_the_focus_and_its_limit_far_off() -> None:
    lens = ThinLens(3.7, 9.6e-3, 0.5, 4.8e-6)
    blur, quantised, limit, _ = camera.blur_figure(lens, 0.4, 4.0).axes[0].lines
    distance, pixels = np.asarray(blur.get_xdata()), np.asarray(blur.get_ydata())
    (highest, _) = np.asarray(limit.get_ydata())
    assert distance[np.argmin(pixels)] == pytest.approx(0.5, abs=1e-3)
    assert np.all(np.asarray(quantised.get_ydata()) == lens.quantised_blur_radius(distance))
    # Table 2.1: 10.58 pixels at infinity.
    assert highest == pytest.approx(10.58, abs=0.005)


def test_each_pair_has_its_steps_their_difference_and_the_range() -> None:
    table = read_lens_table()
    pairs = rank_pairs(table, 1.5, 2.2)[:3]
    figure = camera.pair_figure(table, pairs)
    for axis, pair in zip(figure.axes, pairs, strict=True):
        first, second, difference = (np.asarray(line.get_ydata()) for line in axis.lines)
        assert np.array_equal(difference, np.abs(first - second))
        within = np.isin(table.distances, pair.distances)
        assert tuple(difference[within].astype(int)) == pair.differences
        left, right = axis.patches[0].get_extents().intervalx
        shown = axis.transData.inverted().transform([(left, 0), (right, 0)])[:, 0]
        assert shown == pytest.approx((pair.distances[0], pair.distances[-1]))
