import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES
from dfdbench.errors import MethodError
from dfdbench.methods.sgm import SemiGlobal
from tests.methods.made_planes import inside, pair_of, plane, texture

PUBLISHED = RECIPES["published"]


@pytest.mark.parametrize("level", [5, 60, 120, 200, 250])
def test_a_plane_is_found(level: int) -> None:
    pair = plane(level)
    found = inside(SemiGlobal(PUBLISHED)(pair.infocus, pair.defocus))
    assert np.abs(found - level).mean() < 1


def test_it_fills_what_has_no_texture_from_around() -> None:
    infocus = texture(5)
    infocus[20:40, 30:50] = 120
    pair = pair_of(infocus, np.full((64, 80), 90, np.uint8))
    found = SemiGlobal(PUBLISHED)(pair.infocus, pair.defocus)
    assert np.abs(found[24:36, 34:46] - 90).max() < 5


def test_wrong_parameters_are_all_named() -> None:
    with pytest.raises(MethodError) as caught:
        SemiGlobal(PUBLISHED, small_step=0, large_step=1e9, limit=0)
    named = [problem.where for problem in caught.value.problems]
    assert named == ["small_step", "large_step", "limit"]
    # The one that was set may be either: the other is the default then.
    for small, large in ((20.0, 15.0), (0.5, 0.25)):
        with pytest.raises(MethodError, match="small_step at most large_step") as both:
            SemiGlobal(small_step=small, large_step=large)
        assert both.value.problems[0].where == "small_step and large_step"
