from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")

from dfdbench.training.search.particle import COMPONENTS, Bounds, box_of
from dfdbench.training.search.variants import VARIANTS


def test_the_author_s_box_is_the_text_s_but_for_what_is_said() -> None:
    text, author = (box_of(Bounds(), VARIANTS[name]) for name in ("thesis", "author"))
    assert np.array_equal(text.low, author.low)
    assert np.array_equal(text.high, author.high)
    sizes = np.array([name.startswith(("rows", "columns")) for name in COMPONENTS])
    assert np.array_equal(text.fastest != author.fastest, sizes)
    assert (set(text.fastest[sizes]), set(author.fastest[sizes])) == ({2.0}, {1.0})
    assert [COMPONENTS[i] for i in np.flatnonzero(text.wraps != author.wraps)] == ["crop"]
    assert (text.whole, author.whole) == (False, True)
