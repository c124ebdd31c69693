from __future__ import annotations

from pathlib import Path

import numpy as np

from dfdbench.figures.captures import overlay_figure, temperature_figure, voltage_figure
from dfdbench.figures.style import write_figure
from dfdbench.optics.white_dot import Measurement


def measured(step: int, sharpness: float, temperature: float = 40.0) -> Measurement:
    return Measurement(step, temperature, sharpness, sharpness / 2)


def test_depth_maps_lie_over_one_image_on_one_scale(tmp_path: Path) -> None:
    image = np.full((20, 30, 3), 90, np.uint8)
    levels = np.linspace(50, 200, 600).reshape(20, 30).astype(np.uint8)
    valid = levels > 80
    figure = overlay_figure(image, {"parallel": (levels, valid), "turned": (levels, valid)}, "k33")
    panels = figure.axes[:2]
    assert [axis.get_title() for axis in panels] == ["parallel", "turned"]
    scales = {axis.images[1].get_clim() for axis in panels}
    assert scales == {(float(levels[valid].min()), 200.0)}
    for axis in panels:
        below, above = (
            np.ma.masked_invalid(np.asarray(image.get_array())) for image in axis.images
        )
        assert np.array_equal(np.ma.getmaskarray(above), ~valid)
        # A dark image is drawn brighter, and what is known is outlined.
        assert below.max() == 1
        assert axis.collections
    write_figure(figure, tmp_path / "overlay.png")


def test_a_depth_map_without_a_known_pixel_is_drawn_too(tmp_path: Path) -> None:
    image = np.zeros((8, 9, 3), np.uint8)
    nothing = (np.zeros((8, 9), np.uint8), np.zeros((8, 9), bool))
    write_figure(overlay_figure(image, {"none": nothing}, "k33"), tmp_path / "overlay.png")


def test_sharpness_is_drawn_over_temperature_with_its_background() -> None:
    figure = temperature_figure([measured(135, 0.2, 30), measured(135, 0.4, 50)])
    sharpness, background = figure.axes[0].lines
    assert np.array_equal(sharpness.get_xydata(), [[30, 0.2], [50, 0.4]])
    assert np.array_equal(background.get_ydata(), [0.1, 0.2])
    assert "voltage step 135" in figure.axes[0].get_title()


def test_each_way_through_the_steps_is_a_line_that_says_where_it_goes() -> None:
    up = [measured(127, 0.1), measured(143, 0.3)]
    down = [measured(127, 0.2), measured(143, 0.4)]
    labels = [line.get_label() for line in voltage_figure(up, down).axes[0].lines]
    assert labels == ["127 → 143", "143 → 127"]
    assert len(voltage_figure([], down).axes[0].lines) == 1
