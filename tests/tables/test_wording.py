from __future__ import annotations

import pytest

from dfdbench.tables.wording import listed


@pytest.mark.parametrize(
    ("count", "most", "text"),
    [(0, 2, ""), (2, 2, "0, 1"), (3, 2, "0, 1 and 1 more"), (3, None, "0, 1, 2")],
)
def test_a_list_is_whole_or_says_how_much_is_left(count: int, most: int | None, text: str) -> None:
    assert listed(range(count), most) == text
