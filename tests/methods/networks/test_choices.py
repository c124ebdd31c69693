import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.methods.networks.choices import SIZED, reach_of

# That it is what a pixel sees is tested on networks, in test_inference.py.


@given(st.sampled_from(SIZED), st.integers(1, 8))
def test_a_larger_filter_sees_farther_by_its_level_s_step(layer: int, sampling: int) -> None:
    sizes = dict.fromkeys(SIZED, (3, 3))
    step = {32: 4, 29: 4, 40: 2, 37: 2, 24: 2, 20: 2, 17: 2}.get(layer, 1)
    more = reach_of(sizes | {layer: (1, 5)}, sampling) - reach_of(sizes, sampling)
    assert 0 < more <= 2 * step if step > 1 else more == 1
