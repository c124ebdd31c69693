"""Figure of a measured blur law: widths by depth level, and what the law leaves."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from dfdbench.figures.style import COLOURS, legend_beside
from dfdbench.methods.calibration import Calibration


def law_figure(calibration: Calibration) -> Figure:
    """Draw a law's widths over the depth levels with what was measured, and the residual below.

    Parameters
    ----------
    calibration : Calibration
        From `dfdbench.methods.calibration.calibrate`. Each level's dot is as large as the number
        of its pixels tells; levels without pixels have none.
    """
    law = calibration.law
    levels = np.arange(law.levels)
    figure = Figure(figsize=(9, 6), layout="constrained")
    widths, left = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    most = max(int(calibration.pixels.max()), 1)
    sizes = 4 + 60 * calibration.pixels[: law.levels] / most
    widths.scatter(
        levels, calibration.measured, sizes, color=COLOURS[1], label="each level by itself"
    )
    widths.plot(levels, law.sigmas, color=COLOURS[0], label="the law")
    images = "linear light" if law.linear else "grey levels"
    place = "registered" if law.registered else "moved, each pair its own way"
    gain = f"gain {law.gain:.3f}" if law.even else "a gain a pair"
    widths.set(
        ylabel="standard deviation (pixels)",
        title=f"kernels exp(-(r / c)^p), p = {law.exponent:g}; {images}; {place}; {gain}",
    )
    # A level that shows no blur may be off by pixels: the law sets the scale.
    widths.set_ylim(0, 1.3 * max(law.sigmas))
    legend_beside(widths)
    left.plot(levels, calibration.residual, ".", color=COLOURS[0])
    left.set(xlabel="depth level", ylabel="residual (grey levels, rms)", xlim=(0, law.levels - 1))
    left.set_ylim(bottom=0)
    for axis in (widths, left):
        axis.grid(alpha=0.3)
    return figure
