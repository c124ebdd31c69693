from __future__ import annotations

import pytest

pytest.importorskip("torch", reason="needs the extra nets")

from dfdbench.methods.networks.widths import FILTERS, narrowed


def test_there_are_17_reductions_and_f_02_02_is_as_the_code_has_it() -> None:
    # The thesis's network, its reductions, the swarm's.
    assert len(FILTERS) == 1 + 17 + 1
    expected = [96, 44, 96, 104, 150, 104, 190, 253, 190, 145, 112, 109, 112, 93, 71, 18, 71, 256]
    assert list(FILTERS["F-02-02"]) == expected
    high = [-(-number // 8) * 8 for number in expected[:-1]]
    assert list(FILTERS["F-02-02H"][:-1]) == high


def test_widths_are_divided_but_for_the_levels() -> None:
    assert narrowed((8, 20, 256), 8) == (1, 2, 256)
    assert narrowed((3, 20, 256), 8)[0] == 1
