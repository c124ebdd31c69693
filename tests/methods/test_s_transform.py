import numpy as np
import pytest

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.recipe import BlurRecipe
from dfdbench.errors import MethodError
from dfdbench.methods.s_transform import STransform
from tests.methods.made_planes import PUBLISHED, inside, pair_of, plane, slope


def test_its_variance_is_that_of_the_blur() -> None:
    # Coarse texture: near enough to a cubic polynomial for the paper's theorem.
    waves = 120 + 60 * np.sin(np.arange(90) / 9)[:, np.newaxis] * np.cos(np.arange(90) / 8)
    infocus = np.repeat(waves[..., np.newaxis], 3, axis=2).round().astype(np.uint8)
    pair = pair_of(infocus, np.full((90, 90), 155, np.uint8), BlurRecipe(1.0, 0.01))
    assert np.median(STransform().variance(pair.infocus, pair.defocus)) == pytest.approx(4, rel=0.1)


def test_it_follows_a_recipe_that_is_not_inverted() -> None:
    recipe = BlurRecipe(0.4, 0.04, levels=64, invert=False)
    pair = plane(40, 2, recipe=recipe)
    assert abs(float(np.median(STransform(recipe)(pair.infocus, pair.defocus))) - 40) < 4


def test_a_law_that_turns_is_refused_since_its_inverse_is_not_one_level() -> None:
    sigmas = tuple((0.4 + np.abs(np.arange(256) - 128) * 0.015).tolist())
    with pytest.raises(MethodError, match="recipe=null"):
        STransform(BlurLaw(sigmas))
    pair = plane(120)
    falling = BlurLaw(tuple(PUBLISHED.sigmas[::-1].tolist()))
    by_law = STransform(falling)(pair.infocus, pair.defocus)
    by_recipe = STransform(PUBLISHED)(pair.infocus, pair.defocus)
    np.testing.assert_allclose(by_law, by_recipe, atol=1e-3)


def test_fitted_it_does_about_as_well_as_told() -> None:
    told, fitted = STransform(PUBLISHED), STransform()
    assert told.fit is None
    assert fitted.fit is not None
    fitted.restore(fitted.fit([slope(seed) for seed in range(3)]))
    pair = slope(9)
    errors = [
        np.abs(inside(method(pair.infocus, pair.defocus) - pair.levels)).mean()
        for method in (told, fitted)
    ]
    assert errors[1] < 1.1 * errors[0] < 25
