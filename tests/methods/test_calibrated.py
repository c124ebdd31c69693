"""What is told is not measured, and what is measured is all that is needed."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import LEVELS, RECIPES, BlurRecipe
from dfdbench.errors import MethodError
from dfdbench.methods.calibrated import Calibrated
from dfdbench.methods.guided import Guided
from dfdbench.methods.rational_filters import RationalFilters
from dfdbench.methods.sgm import SemiGlobal
from tests.methods.made_planes import inside, learned_law, slope


def test_who_is_told_the_blur_has_no_fit_and_solves_with_it() -> None:
    few = BlurRecipe(0.3, 0.1, levels=16)
    for told in (RECIPES["published"], few, BlurLaw(tuple(few.sigmas.tolist()))):
        method = Calibrated(told)
        assert method.fit is None
        assert method.blur == told
        assert method.levels == told.levels


def test_who_is_neither_told_nor_fitted_says_so() -> None:
    method = Calibrated(None)
    assert method.fit is not None
    assert method.levels == LEVELS
    with pytest.raises(MethodError, match="not told the blur, and was not fitted"):
        _ = method.blur


@pytest.mark.slow
def test_what_a_fit_returned_is_taken_back_by_another() -> None:
    first, second = Calibrated(None), Calibrated(None)
    first.restore(dict(learned_law()))
    second.restore({name: np.asarray(value) for name, value in learned_law().items()})
    assert first.blur == second.blur
    assert isinstance(first.blur, BlurLaw)
    # The made slopes are blurred as published.
    middle = slice(40, 216)
    found = np.asarray(first.blur.sigmas)[middle]
    assert np.abs(found - RECIPES["published"].sigmas[::-1][middle]).max() < 0.15


@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "levels_more"), [(Guided, 1.5), (SemiGlobal, 1.5), (RationalFilters, 3)]
)
def test_fitted_a_method_does_about_as_well_as_told(
    made: Callable[..., Any], levels_more: float
) -> None:
    told, fitted = made(RECIPES["published"]), made()
    assert fitted.fit is not None
    fitted.restore(learned_law())
    pair = slope(9)
    errors = [
        np.abs(inside(method(pair.infocus, pair.defocus) - pair.depth)).mean()
        for method in (told, fitted)
    ]
    assert errors[1] < errors[0] + levels_more
