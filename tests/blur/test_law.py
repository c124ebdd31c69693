import tomllib

import numpy as np
import pytest

from dfdbench.blur.law import BlurLaw, law_of_fields
from dfdbench.blur.recipe import RECIPES
from dfdbench.errors import InputError


def test_a_law_is_read_from_the_file_that_it_writes() -> None:
    law = BlurLaw((2.0, 0.5, 1.25), 3.5, 15, 1.02, -0.5, (0.3, 4.0), 0.9, True, False, False)
    assert law_of_fields(tomllib.loads(law.as_toml())) == law
    assert law_of_fields(law.as_dict()) == law
    assert hash(law) == hash(law_of_fields(law.as_dict()))


def test_a_gaussian_law_has_the_recipes_kernels() -> None:
    recipe = RECIPES["published"]
    law = BlurLaw(tuple(recipe.sigmas[::-1].tolist()))
    rows = recipe.kernels()[::-1]
    expected = np.einsum("ia,ib->iab", rows, rows)
    assert np.abs(law.kernels() - expected).max() < 1e-12
    assert law.depth_of_level(7) == 7


def test_a_law_that_is_none_is_refused_by_field() -> None:
    for fields, said in (
        ({}, "sigmas"),
        ({"sigmas": [1.0, 0.0]}, "sigmas"),
        ({"sigmas": [1.0, "2"]}, "sigmas"),
        ({"sigmas": [1.0, 2.0], "kernel_size": 8}, "kernel_size"),
        ({"sigmas": [1.0, 2.0], "offset": float("nan")}, "offset"),
        ({"sigmas": [1.0, 2.0], "noise": [0.3, -0.1]}, "noise"),
        ({"sigmas": [1.0, 2.0], "linear": 1}, "linear"),
        ({"sigmas": [1.0, 2.0], "similarity": [0.0, 0.0, 0.0, -1.0]}, "similarity"),
        ({"sigmas": [1.0, 2.0], "similarity": [0.0, 0.0, 0.0]}, "similarity"),
        ({"sigmas": [1.0, 2.0], "falloff": [[]]}, "falloff"),
        ({"sigmas": [1.0, 2.0], "falloff": [[1.0, 0.0]]}, "falloff"),
        ({"sigmas": [1.0, 2.0], "falloff": [[1.0, 0.9], [1.0, 0.9]]}, "two curves"),
        ({"sigmas": [1.0, 2.0], "sigma_min": 1}, "sigma_min"),
    ):
        with pytest.raises(InputError, match=said):
            law_of_fields(fields)
