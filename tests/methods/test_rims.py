"""Where surfaces end on a stack whose near surface covers what lies behind it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from xarray import DataArray

from dfdbench.blur.law import BlurLaw
from dfdbench.blur.occlusion import composite_layers, without_tails
from dfdbench.methods.measured_law import Calibration
from dfdbench.methods.registry import load
from dfdbench.methods.rims import settle_rims
from tests.made_stacks import stack_of
from tests.methods.made_planes import texture

FOCUS = (60.0, 120.0, 180.0)
FAR, NEAR = 60, 180
LAWS = [
    BlurLaw(tuple(0.1 + 0.02 * np.abs(np.arange(256) - focus)), kernel_size=27, noise=(0.29,))
    for focus in FOCUS
]


def made_scene() -> tuple[DataArray, NDArray[np.float32]]:
    """Return a stack of a near square before a far wall, and its depth."""
    sharp = texture(3, 60, 70)
    levels = np.full(sharp.shape[:2], FAR)
    levels[20:42, 22:47] = NEAR
    images = [
        np.rint(composite_layers(sharp.astype(float), levels, without_tails(law.kernels())))
        for law in LAWS
    ]
    stack = stack_of([image.astype(np.uint8) for image in images], FOCUS, sharp)
    return stack, levels.astype(np.float32)


def wrong(found: NDArray[Any], levels: NDArray[Any]) -> int:
    """Return how many pixels lie on the wrong surface."""
    return int((np.abs(found - levels) > (NEAR - FAR) / 2).sum())


@pytest.mark.parametrize("grown", [-2, 0, 2])
def test_a_near_surface_too_large_or_too_small_gets_its_own_size(grown: int) -> None:
    stack, levels = made_scene()
    start = np.full_like(levels, FAR + 0.25)
    start[20 - grown : 42 + grown, 22 - grown : 47 + grown] = NEAR + 0.25
    images = stack.values
    settled = settle_rims(LAWS, images[0], list(images[1:]), start)
    assert wrong(start, levels) > 100 or not grown
    assert wrong(settled, levels) <= 8
    # What is not changed keeps its fraction of a level.
    np.testing.assert_allclose(settled[28:34, 30:40], NEAR + 0.25)


def turned(laws: Sequence[BlurLaw]) -> list[BlurLaw]:
    """Return the laws of the same images for levels that grow with distance."""
    return [replace(law, sigmas=law.sigmas[::-1]) for law in laws]


@pytest.mark.parametrize("grown", [-2, 2])
def test_levels_that_grow_with_distance_are_settled_as_their_opposites(grown: int) -> None:
    stack, levels = made_scene()
    start = np.full_like(levels, FAR + 0.25)
    start[20 - grown : 42 + grown, 22 - grown : 47 + grown] = NEAR + 0.25
    images = stack.values[0], list(stack.values[1:])
    settled = settle_rims(LAWS, *images, start)
    other = settle_rims(turned(LAWS), *images, 255 - start, farther_is_higher=True)
    np.testing.assert_array_equal(other, 255 - settled)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sgm", "guided", "local"])
@pytest.mark.parametrize("farther_is_higher", [False, True])
def test_solvers_settle_the_rims_of_a_stack(name: str, farther_is_higher: bool) -> None:
    stack, levels = made_scene()
    laws, truth = (turned(LAWS), 255 - levels) if farther_is_higher else (LAWS, levels)
    nothing = np.full(256, np.nan), np.zeros(256, np.int64), np.full(256, np.nan)
    learned = Calibration.all_as_learned([Calibration(law, *nothing) for law in laws])
    method: Any = load(name, recipe=None)
    method.restore(learned | {"farther_is_higher": int(farther_is_higher)})
    assert wrong(method.from_stack(stack), truth) <= 4
