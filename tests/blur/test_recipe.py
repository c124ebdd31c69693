import numpy as np
import pytest

from dfdbench.blur.recipe import RECIPES, BlurRecipe, find_recipe
from dfdbench.errors import InputError, UnknownNameError


def test_levels_and_depths_are_inverse() -> None:
    levels = np.arange(256)
    for recipe in (*RECIPES.values(), BlurRecipe(1, 0.1, invert=False)):
        assert np.array_equal(recipe.depth_of_level(recipe.level_of_depth(levels)), levels)


def test_the_recipes_are_those_of_the_thesis_and_its_images() -> None:
    published, text = RECIPES["published"], RECIPES["text"]
    assert published.sigma_step == 2.88 / 256
    assert text.sigma_step == 2.56 / 256
    assert np.allclose(published.kernels().sum(axis=1), 1)
    assert find_recipe(published.as_dict()) == published


def test_wrong_recipes_are_named() -> None:
    with pytest.raises(InputError) as caught:
        BlurRecipe(sigma_min=0, sigma_step=float("nan"), levels=1, kernel_size=4)
    for part in ("sigma_min", "sigma_step", "levels", "kernel_size"):
        assert part in str(caught.value)
    with pytest.raises(UnknownNameError, match="did you mean published"):
        find_recipe("publishd")
    with pytest.raises(InputError) as caught:
        find_recipe({"sigma_mni": 1, "sigma_step": -1, "levels": 1})
    said = [(problem.what, problem.where) for problem in caught.value.problems]
    assert said == [
        ("unknown field of a blur recipe", "sigma_mni"),
        ("a field of the blur recipe is lacking", "sigma_min"),
        ("wrong blur recipe", "sigma_step"),
        ("wrong blur recipe", "levels"),
    ]


def test_a_gaussian_of_which_the_kernel_holds_only_the_middle_is_refused() -> None:
    with pytest.raises(InputError, match=r"sigma_min \+ 255 \* sigma_step") as caught:
        BlurRecipe(1e9, 0.01)
    assert "is above kernel_size" in str(caught.value)
    with pytest.raises(InputError, match=r"sigma_step, 27\.1, is above"):
        BlurRecipe(26, 0.11, levels=11)
    assert BlurRecipe(26, 0.1, levels=11).sigmas[-1] == pytest.approx(27)
