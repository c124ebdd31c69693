import numpy as np
import pytest

from dfdbench.blur.light import encode
from dfdbench.simulation.textures import PATTERNS, Draws, pattern


@pytest.mark.parametrize("kind", list(PATTERNS))
def test_a_pattern_is_reflectance_in_whole_grey_levels_and_follows_its_key(kind: str) -> None:
    first, again, other = (pattern(kind, Draws("test", kind, key)) for key in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert first.shape == (384, 384, 3)
    grey = encode(first)
    assert np.abs(grey - np.rint(grey)).max() < 1e-6
    texture = grey.std(axis=(0, 1)).max()
    assert texture < 2 if kind == "plain" else texture > 4


def test_the_same_key_gives_the_same_numbers_past_a_block() -> None:
    streams = [Draws("room", 1, 2), Draws("room", 1, 2), Draws("room", 1, 3)]
    first, again, other = ([stream.share() for _ in range(3000)] for stream in streams)
    assert first == again
    assert first != other
    assert len(set(first)) == 3000
