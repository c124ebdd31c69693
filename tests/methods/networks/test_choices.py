import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.methods.networks.choices import SIZED, kernel_sizes, narrowed, reach_of


def test_sizes_are_those_of_the_thesis_s_layers() -> None:
    assert SIZED == (52, 48, 45, 40, 37, 32, 29, 24, 20, 17, 12, 8, 5, 1)
    assert kernel_sizes([1, *[3] * 12, [5, 7]])[1] == (5, 7)


def test_widths_are_divided_but_for_the_levels() -> None:
    assert narrowed((8, 20, 256), 8) == (1, 2, 256)
    assert narrowed((3, 20, 256), 8)[0] == 1


# That it is what a pixel sees is tested on networks, in test_inference.py.


@given(st.sampled_from(SIZED), st.integers(1, 8))
def test_a_larger_filter_sees_farther_by_its_level_s_step(layer: int, sampling: int) -> None:
    sizes = dict.fromkeys(SIZED, (3, 3))
    step = {32: 4, 29: 4, 40: 2, 37: 2, 24: 2, 20: 2, 17: 2}.get(layer, 1)
    more = reach_of(sizes | {layer: (1, 5)}, sampling) - reach_of(sizes, sampling)
    assert 0 < more <= 2 * step if step > 1 else more == 1
