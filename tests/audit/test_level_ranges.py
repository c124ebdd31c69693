import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.audit.level_ranges import as_ranges, range_text, runs


@given(keys=st.lists(st.sampled_from(["a", "b", None]), max_size=20))
def test_runs_are_whole_apart_and_of_one_key(keys: list[str | None]) -> None:
    found = runs(keys)
    held = {level for first, last in found for level in range(first, last + 1)}
    assert held == {level for level, key in enumerate(keys) if key is not None}
    for first, last in found:
        assert len(set(keys[first : last + 1])) == 1
    for (_, last), (first, _) in itertools.pairwise(found):
        # Neighbours of one key would be one run.
        assert first > last + 1 or keys[first] != keys[last]


def test_levels_at_both_ends_are_told() -> None:
    marked = np.zeros(256, bool)
    assert as_ranges(marked) == ""
    marked[[0, 1, 255]] = True
    assert as_ranges(marked) == "0-1, 255"
    assert as_ranges(np.ones(256, bool)) == range_text(0, 255) == "0-255"
