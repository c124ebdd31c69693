import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.blur.recipe import RECIPES, BlurRecipe
from dfdbench.blur.synthesis import synthesize
from dfdbench.errors import MethodError
from dfdbench.evaluation.check import made_pair
from dfdbench.methods.baselines import Local, PositionalPrior

Image = NDArray[np.uint8]


def test_local_uses_the_recipe_it_is_given() -> None:
    image = np.random.default_rng(2).integers(0, 256, (40, 40, 3)).astype(np.uint8)
    depth = np.full((40, 40), 37, np.uint8)
    for recipe in (RECIPES["text"], BlurRecipe(0.4, 0.03, levels=64, invert=False)):
        found = Local(recipe)(image, synthesize(image, depth, recipe))
        assert np.abs(found - 37).max() <= 3


def test_a_positional_prior_skips_what_is_unknown_and_fits_images_of_any_size() -> None:
    image = np.zeros((48, 64, 3), np.uint8)
    near, far = np.full((48, 64), 200, np.uint8), np.full((48, 64), 40, np.uint8)
    known = np.ones((48, 64), bool)
    known[:, 32:] = False
    prior = PositionalPrior()
    with pytest.raises(MethodError, match="no training captures yet"):
        prior(image, image)
    pairs = [made_pair(image, image, near, known), made_pair(image, image, far, ~known)]
    prior.restore(prior.fit(pairs))
    found = prior(np.zeros((24, 100, 3), np.uint8), np.zeros((24, 100, 3), np.uint8))
    assert (found.shape, found[:, [0, -1]].tolist()) == ((24, 100), [[200, 40]] * 24)
    prior.restore(prior.fit([made_pair(image, image, near, known)]))
    assert (prior(image, image) == 200).all()
    with pytest.raises(MethodError, match="nothing to fit"):
        prior.fit([made_pair(image, image, near, np.zeros_like(known))])
