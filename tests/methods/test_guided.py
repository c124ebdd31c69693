import numpy as np
from scipy.ndimage import uniform_filter

from dfdbench.blur.recipe import RECIPES
from dfdbench.methods.baselines import Local
from dfdbench.methods.guided import Guided
from dfdbench.methods.law_cost import level_costs
from tests.methods.made_planes import pair_of, plane, texture

PUBLISHED = RECIPES["published"]


def test_it_keeps_an_edge_that_the_image_shows_better_than_a_window_does() -> None:
    infocus = texture(4)
    infocus[:, 40:] = np.clip(infocus[:, 40:].astype(int) + 90, 0, 255)
    depth = np.full((64, 80), 60, np.uint8)
    depth[:, 40:] = 190
    pair = pair_of(infocus, depth)
    errors = [
        np.abs(method(pair.infocus, pair.defocus) - depth)[:, 30:50].mean()
        for method in (Guided(PUBLISHED), Local(PUBLISHED))
    ]
    assert errors[0] < 0.8 * errors[1]


def test_where_all_windows_count_as_flat_it_averages_twice() -> None:
    pair = plane(120)
    flat = Guided(PUBLISHED, flatness=1e6, window=5)
    twice = level_costs([PUBLISHED], pair.infocus, [pair.defocus], 15).astype(np.float32)
    for _ in range(2):
        twice = uniform_filter(twice, (5, 5, 1), mode="nearest")
    expected = 255 - twice.argmin(2)
    assert np.median(np.abs(flat(pair.infocus, pair.defocus) - expected)) <= 1
