import math

import numpy as np
import pytest

from dfdbench.audit.level_errors import LevelErrors, level_errors

DEPTH = np.array([[9, 9, 80, 0]], np.uint8)
ERRORS = level_errors(DEPTH, DEPTH > 0, np.array([[13, 3, 80.5, 200]], np.float32))
NINE = np.arange(256) == 9


def test_errors_go_by_true_level_and_leave_unknown_pixels_out() -> None:
    assert ERRORS.pixels.sum() == 3
    assert ERRORS.mean(NINE) == 5
    assert ERRORS.root_mean_square(NINE) == pytest.approx(math.sqrt((16 + 36) / 2))
    assert ERRORS.share(NINE) == pytest.approx(2 / 3)
    assert math.isnan(ERRORS.mean(np.arange(256) == 7))


def test_excess_is_what_would_be_gone() -> None:
    # The mean is 10.5 / 3 = 3.5; if level 9 did as level 80 it would be 0.5.
    assert ERRORS.excess(NINE) == pytest.approx(1 - 0.5 / 3.5)
    assert ERRORS.excess(~NINE) < 0
    assert math.isnan(ERRORS.excess(np.ones(256, bool)))


def test_sums_add_up() -> None:
    both = LevelErrors.total([ERRORS, ERRORS])
    assert both.pixels.sum() == 6
    assert both.mean(NINE) == ERRORS.mean(NINE)
    assert math.isnan(LevelErrors.total([]).excess(NINE))
