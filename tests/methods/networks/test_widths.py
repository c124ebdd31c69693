from __future__ import annotations

import pytest

pytest.importorskip("torch", reason="needs the extra nets")

from dfdbench.methods.networks.widths import FILTERS, LAYERS, narrowed


def test_there_are_17_reductions_and_f_02_02_is_as_the_code_has_it() -> None:
    # The thesis's network, its reductions, the swarm's.
    assert len(FILTERS) == 1 + 17 + 1
    expected = [96, 44, 96, 104, 150, 104, 190, 253, 190, 145, 112, 109, 112, 93, 71, 18, 71, 256]
    assert list(FILTERS["F-02-02"]) == expected
    high = [-(-number // 8) * 8 for number in expected[:-1]]
    assert list(FILTERS["F-02-02H"][:-1]) == high
    # It is called rounded down, and is printed so in four of the layers that are no multiple of 8.
    low = dict(zip(LAYERS, FILTERS["F-02-02L"], strict=True))
    wide = dict(zip(LAYERS, expected, strict=True))
    assert {layer for layer in LAYERS if low[layer] < wide[layer]} == {48, 40, 27, 8}
    assert {layer for layer in LAYERS if low[layer] > wide[layer]} == {34, 32, 29, 20, 15, 12, 5}


def test_widths_are_divided_but_for_the_levels() -> None:
    assert narrowed((8, 20, 256), 8) == (1, 2, 256)
    assert narrowed((3, 20, 256), 8)[0] == 1
