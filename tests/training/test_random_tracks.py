from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from dfdbench.blur.formation import form_pair
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.tracks import TRACKS
from dfdbench.training.random_tracks import RandomTracks

RECIPE = RECIPES["published"]


def test_tracks_and_severities_are_drawn_alike() -> None:
    tracks = RandomTracks(RECIPE, list(TRACKS))
    random = np.random.default_rng(0)
    drawn = [tracks.choose(random) for _ in range(2800)]
    counts = Counter((one.track.name, one.severity) for one in drawn)
    assert counts.keys() == {(name, severity) for name in TRACKS for severity in range(4)}
    assert 60 < min(counts.values()) < max(counts.values()) < 140


@pytest.mark.parametrize("name", TRACKS)
def test_a_patch_cut_with_its_margin_is_that_of_the_whole_image(name: str) -> None:
    # Where noise is drawn for each pixel by its place in the image, patch and whole differ.
    random = np.random.default_rng(2)
    image = random.integers(60, 190, (120, 120, 3)).astype(np.uint8)
    depth = np.tile(np.repeat(np.array([80, 140], np.uint8), 60), (120, 1))
    tracks = RandomTracks(RECIPE, [name])
    one = next(d for d in iter(lambda: tracks.choose(random), None) if d.severity == 3)
    margin = tracks.margin_of(one)
    assert margin <= tracks.margin
    _, whole = form_pair(image, depth, RECIPE, one, "training/1/2/3")
    inner = slice(60 - 8, 60 + 8)
    around = slice(60 - 8 - margin, 60 + 8 + margin)
    _, patch = tracks.form(image[around, around], depth[around, around], one, "1/2/3")
    found = patch[margin:-margin, margin:-margin].astype(int)
    noisy = name in ("noise", "camera")
    difference = found - whole[inner, inner]
    assert abs(difference.mean()) < (5 if noisy else 0.01)
    assert noisy or np.abs(difference).max() <= 1
