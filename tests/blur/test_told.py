import numpy as np
import pytest

from dfdbench.blur.formation import decode, form_pair
from dfdbench.blur.law import noise_at
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.told import told_law
from dfdbench.blur.tracks import TRACKS, find_degradation
from dfdbench.methods.law_cost import blurred_by

RECIPE = RECIPES["published"]
LABELS = [
    f"{name}-{n}" for name, track in TRACKS.items() for n in range(1, len(track.severities) + 1)
]


@pytest.mark.parametrize("label", [label for label in LABELS if not label.startswith("occlusion")])
def test_the_law_explains_a_plane_of_every_track(label: str) -> None:
    # A plane shows nothing of layers: what is left of it is the noise that the law tells.
    random = np.random.default_rng(0)
    image = random.integers(60, 190, (64, 64, 3)).astype(np.uint8)
    depth = np.full((64, 64), 100, np.uint8)
    degradation = find_degradation(label)
    infocus, defocus = form_pair(image, depth, RECIPE, degradation, "Art/view1")
    law = told_law(RECIPE, degradation.formation)
    blurred = blurred_by(law, infocus, defocus, np.array([100]))
    inner = (slice(12, -12), slice(12, -12))
    left = (blurred.of_level(0) - blurred.aim)[inner]
    expected = blurred.noise[inner] * np.sqrt(blurred.spread[0])
    assert np.sqrt(np.mean(np.square(left / expected))) == pytest.approx(1, abs=0.25)


def test_noise_is_what_a_grey_patch_shows() -> None:
    grey = np.full((64, 64, 3), 90, np.uint8)
    depth = np.zeros((64, 64), np.uint8)
    for label in ("noise-3", "camera-3"):
        degradation = find_degradation(label)
        _, defocus = form_pair(grey, depth, RECIPE, degradation, "Art/view1")
        law = told_law(RECIPE, degradation.formation)
        told = noise_at(law.noise, np.array(90.0))
        seen = 255 * decode(defocus.astype(float)) if law.linear else defocus
        assert float(seen.std()) == pytest.approx(float(told), rel=0.05)


def test_what_a_law_cannot_say_it_leaves_to_be_found_a_pair() -> None:
    shift, gain = (
        told_law(RECIPE, find_degradation(f"{n}-2").formation) for n in ("shift", "gain")
    )
    assert (shift.registered, shift.even) == (False, True)
    assert (gain.registered, gain.even) == (True, False)
