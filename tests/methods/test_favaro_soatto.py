import numpy as np

from dfdbench.blur.recipe import BlurRecipe
from dfdbench.datasets.captures import Capture
from dfdbench.evaluation.check import made_pair
from dfdbench.methods.favaro_soatto import FavaroSoatto
from tests.methods.made_planes import inside, plane, slope, with_defocus


def test_a_law_and_a_shape_that_nobody_told_are_learned() -> None:
    # A blur that grows with nearness, and a defocus image darker and lighter than the other.
    recipe = BlurRecipe(0.4, 0.01, invert=False)

    def changed(seed: int) -> Capture:
        pair = slope(seed, recipe=recipe)
        return with_defocus(pair, 0.8 * pair.defocus + 15)

    method = FavaroSoatto()
    method.restore(method.fit([changed(seed) for seed in range(2)]))
    pair = changed(9)
    assert np.abs(inside(method(pair.infocus, pair.defocus) - pair.levels)).mean() < 5


def test_pixels_of_unknown_depth_are_not_learned_from() -> None:
    pair = slope(1)
    spoilt = pair.levels.copy()
    spoilt[:48] = 3
    half = pair.valid.copy()
    half[:48] = False
    learned = FavaroSoatto(groups=16).fit([made_pair(pair.infocus, pair.defocus, spoilt, half)])
    whole = made_pair(pair.infocus, pair.defocus, pair.levels, half)
    assert np.array_equal(learned["operators"], FavaroSoatto(groups=16).fit([whole])["operators"])


def test_depths_that_were_never_seen_are_never_answered() -> None:
    method = FavaroSoatto()
    seen = [plane(level, seed) for seed, level in enumerate((100, 110, 120))]
    method.restore(method.fit(seen))
    pair = plane(30, seed=9)
    found = method(pair.infocus, pair.defocus)
    assert 100 <= found.min() <= found.max() <= 120
