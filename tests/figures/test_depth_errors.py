import numpy as np
import pytest

from dfdbench.audit.depth_errors import DepthErrors
from dfdbench.audit.run_errors import LevelErrors
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.figures.depth_errors import depth_error_figure


def errors_of(name: str, told: int) -> DepthErrors:
    """A hundred pixels at each of the levels 40 to 79, all answered by one level."""
    pixels, answers = np.zeros(256, np.int64), np.zeros((256, 256), np.int64)
    pixels[40:80] = 100
    answers[40:80, told] = 100
    off = np.asarray(np.abs(np.arange(256.0) - told) * pixels, np.float64)
    return DepthErrors(name, ("a",), LevelErrors(pixels, off, np.square(off)), None, answers)


def test_each_run_has_a_curve_and_a_panel_of_its_answers() -> None:
    found = [errors_of("near", 70), errors_of("$far$", 41)]
    figure = depth_error_figure("title", found, DepthScale(near=0.5, far=5.0))
    top, *panels = figure.axes
    assert [line.get_label() for line in top.lines] == ["near", r"\$far\$"]
    levels, means = top.lines[0].get_data()
    shown = ~np.isnan(np.asarray(means))
    assert np.asarray(levels)[shown].tolist() == [*np.arange(41.5, 80, 4)]
    assert np.asarray(means)[shown][0] == pytest.approx(70 - 41.5)
    metres = top.child_axes[0]
    named = [text.get_text() for text in metres.get_xticklabels()]
    # 2.5 m would be left of the levels that occur.
    assert named == ["2", "1.5"]
    assert len(panels) == 2
    # All of a true level's pixels lie on the one answer; where there are none it is blank.
    image = np.asarray(panels[0].images[0].get_array())
    assert image[70 // 4, 40 // 4] == 1
    assert image.sum() == 10
