from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")

from hypothesis import given, settings
from hypothesis import strategies as st

from dfdbench.errors import InputError
from dfdbench.methods.networks.choices import FILTERS, LAYERS, SIZED
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.search.particle import (
    COMPONENTS,
    PATCHES,
    ROWS,
    Bounds,
    bounds_of,
    box_of,
    particle_at,
    position_of,
    whole_numbers,
)
from dfdbench.training.search.swarm import begun
from dfdbench.training.search.variants import VARIANTS


def test_a_particle_has_51_components_as_the_author_counts_them() -> None:
    assert len(COMPONENTS) == len(set(COMPONENTS)) == 12 + 2 * 10 + 9 + 9 + 1 == 51
    # The author's map from layers to rows, output to input; row 1 is fixed.
    rows = [1, 2, 3, 2, 4, 5, 6, 5, 7, 8, 9, 8, 10, 11, 10, 12, 13, 12]
    for layer, row in list(zip(reversed(LAYERS), rows, strict=True))[1:]:
        assert layer in ROWS[row - 2][0]
    free = {layer for _, sized in ROWS for layer in sized}
    assert free == set(SIZED) - {1}


@pytest.mark.parametrize("name", FILTERS)
def test_every_named_network_is_a_particle_s(name: str) -> None:
    first = "sigmoid" if name == "pso" else "prelu"
    particle = particle_at(position_of(FILTERS[name], first_activation=first))
    found = TrainingConfiguration.model_validate(particle.model_dump()).architecture("dfd-net")
    named = TrainingConfiguration(
        filters=name, first_activation="sigmoid" if name == "pso" else "prelu"
    )
    assert found == named.architecture("dfd-net")
    assert particle.crop == 32


def test_mapping_functions_are_those_of_appendix_c() -> None:
    position = position_of(FILTERS["original"])
    position[COMPONENTS.index("width_5_12")] = 127.5
    position[COMPONENTS.index("rows_5_12")] = 3.4999
    position[COMPONENTS.index("columns_5_12")] = 3.5
    position[COMPONENTS.index("activation_entry")] = 5.6  # goes round to ReLU
    position[COMPONENTS.index("activation_classify")] = 4.6
    position[COMPONENTS.index("normalized_entry")] = 0.49
    position[COMPONENTS.index("crop")] = 12.5
    found = particle_at(position)
    sizes = dict(zip(SIZED, found.kernels, strict=True))
    assert sizes[5] == sizes[12] == (7, 9)
    assert sizes[1] == sizes[48] == (3, 3)
    widths = dict(zip(LAYERS, found.filters, strict=True))
    assert widths[5] == widths[12] == 128
    assert (found.activations[0], found.activations[-1]) == ("relu", "srelu")
    assert found.normalized == [False] + [True] * 8
    assert found.crop == 64


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(VARIANTS)))
def test_all_of_the_box_is_networks_and_back(seed: int, variant: str) -> None:
    box = box_of(Bounds(), VARIANTS[variant])
    (position,) = begun(box, 1, seed).positions
    particle = particle_at(position)
    assert set(particle.filters[:-1]) <= set(range(8, 513))
    assert {side for size in particle.kernels for side in size} <= {1, 3, 5, 7, 9}
    assert particle.crop in PATCHES
    TrainingConfiguration.model_validate(particle.model_dump()).architecture("dfd-net")
    again = position_of(**particle.model_dump())
    assert np.array_equal(again, whole_numbers(position))


def test_bounds_make_the_box_smaller() -> None:
    box = box_of(
        bounds_of({"width": "16:64", "kernel": "3:5", "crop": "12:24"}), VARIANTS["thesis"]
    )
    ends = {name: (box.low[i], box.high[i]) for i, name in enumerate(COMPONENTS)}
    assert ends["width_8"] == (16, 64)
    assert ends["rows_8"] == ends["columns_48"] == (1, 2)
    assert ends["crop"] == (0, 3)
    assert ends["activation_entry"] == (0, 5)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"kernel": "2:9"}, "odd numbers"),
        ({"crop": "12:30"}, "multiples of 4"),
        ({"width": "9:8"}, "lower bound first"),
        ({"width": "8"}, "field is missing"),
        ({"kernel": "1:11"}, "less than or equal to 9"),
        ({"height": "1:2"}, "unknown field"),
        ({"width": "a:b"}, "integer"),
    ],
)
def test_what_are_no_bounds_is_told(given: dict[str, str], told: str) -> None:
    with pytest.raises(InputError, match=told) as caught:
        bounds_of(given)
    assert "--bounds" in str(caught.value)


def test_a_network_that_no_particle_describes_is_told() -> None:
    for kernels in ([3] * 13 + [5], [5] + [3] * 13):
        with pytest.raises(InputError, match="no particle describes"):
            position_of(FILTERS["original"], kernels)
    with pytest.raises(InputError, match="crop"):
        position_of(FILTERS["original"], crop=34)
