from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from dfdbench.tables.shown_text import spelt_out, spelt_out_json


@given(st.text())
def test_nothing_that_cannot_be_seen_is_left_and_json_says_the_same(text: str) -> None:
    left = "".join(spelt_out(text).split())
    assert left.isprintable()
    assert json.loads(spelt_out_json(json.dumps(text, ensure_ascii=False))) == text


def test_what_can_be_seen_stays() -> None:
    assert spelt_out("Größe ≤ 5 %\t–\n深度") == "Größe ≤ 5 %\t–\n深度"
