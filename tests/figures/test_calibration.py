import numpy as np

from dfdbench.blur.law import BlurLaw
from dfdbench.figures.calibration import law_figure
from dfdbench.methods.calibration import Calibration


def test_the_law_sets_the_scale_and_levels_without_pixels_have_no_dot() -> None:
    measured = np.full(256, np.nan)
    measured[10:20] = 90.0  # levels that showed no blur
    pixels = np.where(np.isnan(measured), 0, 50)
    law = BlurLaw(tuple(np.linspace(3, 1, 256).tolist()), exponent=8.0, linear=True)
    figure = law_figure(Calibration(law, measured, pixels, measured))
    widths, left = figure.axes
    assert widths.get_ylim() == (0, 1.3 * 3)
    assert "p = 8; linear light" in widths.get_title()
    assert np.isfinite(np.asarray(left.lines[0].get_ydata())).sum() == 10
