"""Where surfaces end on a stack whose near surface covers what lies behind it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.blur.law import BlurLaw
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.registry import load
from dfdbench.methods.rims import settle_rims
from tests.made_stacks import stack_of
from tests.methods.made_planes import in_layers, texture, unmeasured

FOCUS = (60.0, 120.0, 180.0)
FAR, NEAR = 60, 180
# A near square before a far wall, and the images of a stack of it.
SHARP = texture(3, 60, 70)
LEVELS = np.full(SHARP.shape[:2], FAR)
LEVELS[20:42, 22:47] = NEAR
LAWS, IMAGES = in_layers(SHARP, LEVELS, FOCUS)


def begin(grown: int) -> NDArray[np.float32]:
    """Return a depth map whose square is larger by so many pixels on each side."""
    start = np.full(LEVELS.shape, FAR + 0.25, np.float32)
    start[20 - grown : 42 + grown, 22 - grown : 47 + grown] = NEAR + 0.25
    return start


def wrong(found: NDArray[Any], levels: NDArray[Any]) -> int:
    """Return how many pixels lie on the wrong surface."""
    return int((np.abs(found - levels) > (NEAR - FAR) / 2).sum())


@pytest.mark.parametrize("grown", [-2, 0, 2])
def test_a_near_surface_too_large_or_too_small_gets_its_own_size(grown: int) -> None:
    start = begin(grown)
    settled = settle_rims(LAWS, SHARP, IMAGES, start)
    assert wrong(start, LEVELS) > 100 or not grown
    assert wrong(settled, LEVELS) <= 8
    # What is not changed keeps its fraction of a level.
    np.testing.assert_allclose(settled[28:34, 30:40], NEAR + 0.25)


def turned(laws: Sequence[BlurLaw]) -> list[BlurLaw]:
    """Return the laws of the same images for levels that grow with distance."""
    return [replace(law, sigmas=law.sigmas[::-1]) for law in laws]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sgm", "guided", "local"])
@pytest.mark.parametrize("farther_is_higher", [False, True])
def test_solvers_settle_the_rims_of_a_stack(name: str, farther_is_higher: bool) -> None:
    laws, truth = (turned(LAWS), 255 - LEVELS) if farther_is_higher else (LAWS, LEVELS)
    learned = Calibration.all_as_learned(unmeasured(laws))
    method: Any = load(name, recipe=None)
    method.restore(learned | {"farther_is_higher": int(farther_is_higher)})
    assert wrong(method.from_stack(stack_of(IMAGES, FOCUS, SHARP)), truth) <= 4
