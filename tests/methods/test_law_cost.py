import math
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import correlate, gaussian_filter

from dfdbench.blur.law import BlurLaw, noise_at
from dfdbench.blur.light import decode, encode
from dfdbench.blur.recipe import RECIPES
from dfdbench.methods import law_cost
from dfdbench.methods.blurred import blurred_by
from tests.methods.made_planes import plane

SIGMAS = (2.4, 1.1, 0.4, 0.7, 1.6)


def pair() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    random = np.random.default_rng(1)
    infocus = random.integers(0, 256, (21, 26, 3)).astype(np.uint8)
    defocus = cv2.GaussianBlur(infocus, (0, 0), 1) + random.integers(-2, 3, infocus.shape)
    return infocus, np.clip(defocus, 0, 255).astype(np.uint8)


def blurred_at(law: BlurLaw, infocus: NDArray[np.uint8], level: int) -> NDArray[np.float64]:
    kernel = law.kernels()[level][..., np.newaxis]
    return np.asarray(correlate(light(infocus, law), kernel, mode="nearest"))


def light(image: NDArray[np.uint8], law: BlurLaw) -> NDArray[np.float64]:
    grey = image.astype(np.float64)
    return 255 * decode(grey) if law.linear else grey


def noise_by_brightness(law: BlurLaw, aim: NDArray[np.float64]) -> NDArray[np.float64]:
    about = gaussian_filter(aim, (2, 2, 0), mode="mirror", truncate=4)
    grey = encode(about / 255) if law.linear else about
    a_step = 255 * (decode(grey + 0.5) - decode(grey - 0.5)) if law.linear else 1
    return np.maximum(noise_at(law.noise, grey), a_step / math.sqrt(12))


LAWS = [
    # More levels than a block of them has.
    BlurLaw(tuple(np.linspace(0.3, 3, 70).tolist()), kernel_size=15, noise=(2.0,)),
    BlurLaw(SIGMAS, exponent=8.0, kernel_size=15, noise=(3.0, 1.0), infocus_noise=0.8),
    BlurLaw(SIGMAS, exponent=32.0, kernel_size=15, noise=(2.0,), linear=True),
    BlurLaw(SIGMAS, exponent=32.0, kernel_size=15, noise=(0.0, 0.0, 3.0), linear=True),
    BlurLaw(SIGMAS, kernel_size=15, noise=(2.0,), gain=1.1, offset=2.0),
]


@pytest.mark.parametrize("law", LAWS)
def test_costs_and_misfits_equal_the_definition(law: BlurLaw) -> None:
    infocus, defocus = pair()
    aim = (light(defocus, law) - law.offset) / law.gain
    noise = noise_by_brightness(law, aim)
    spread = 1 + law.infocus_noise**2 * np.square(law.kernels()).sum(axis=(1, 2))
    costs, misfits = np.empty((2, 21, 26, len(law.sigmas)))
    for level in range(len(law.sigmas)):
        residual = aim - blurred_at(law, infocus, level)
        nats = np.square(residual / noise).sum(axis=2) / (2 * spread[level])
        costs[..., level] = 4 * (nats + 1.5 * math.log(spread[level]))
        bound = np.sqrt(3 * spread[level]) * noise
        beyond = np.maximum(np.abs(residual) - bound, 0)
        misfits[..., level] = np.sqrt(np.square(beyond).sum(axis=2))
    blurred = blurred_by(law, infocus, defocus)
    unary, offset = law_cost.law_cost(blurred, 4, 60000)
    least = costs.min(axis=2, keepdims=True)
    assert np.abs(unary - np.minimum(costs - least, 60000)).max() <= 2 + 0.002 * costs.max()
    assert offset == pytest.approx(least.sum(), rel=0.002)
    assert np.abs(law_cost.law_misfits(blurred) / law_cost.MISFIT_STEPS - misfits).max() < 0.1
    squares = np.stack(list(law_cost.squares_of(blurred)), axis=2)
    assert squares.dtype == np.float32
    # Two a nat, and of a nat the costs count four.
    assert np.abs(2 * squares - costs).max() <= 0.002 * costs.max()
    for level in range(len(law.sigmas)):
        looks = blurred.nodes @ blurred.factors[:, level]
        assert np.abs(looks - blurred_at(law, infocus, level)).max() < 0.1


def test_an_image_of_a_stack_says_five_nats_at_most() -> None:
    laws = [
        BlurLaw((0.5, 1.0, 2.0), kernel_size=15, noise=(2.0,)),
        BlurLaw((2.0, 1.0, 0.5), kernel_size=15, noise=(2.0,)),
    ]
    infocus, defocus = pair()
    wanted = np.zeros((21, 26, 3))
    for law in laws:
        residuals = [defocus - blurred_at(law, infocus, level) for level in range(3)]
        nats = np.square(np.stack(residuals, axis=3) / 2).sum(axis=2) / 2
        costs = law_cost.UNIT * np.minimum(nats, 5)
        wanted += costs - costs.min(axis=2, keepdims=True)
    found = law_cost.level_costs(laws, infocus, [defocus, defocus], 15)
    assert np.abs(found - wanted).max() < 3


PUBLISHED = RECIPES["published"]


def test_a_nat_of_a_recipe_is_twice_the_variance_of_rounding() -> None:
    pair = plane(120)
    costs = law_cost.level_costs([PUBLISHED], pair.infocus, [pair.defocus], 50)
    assert (costs.shape, costs.max()) == ((64, 80, 256), 50 * law_cost.UNIT)
    assert costs.min(2).max() == 0
    # Rounding leaves half a nat a channel, in the mean.
    right = costs[14:-14, 14:-14, 255 - 120] / law_cost.UNIT
    assert 0 < right.mean() < 1.5


@pytest.mark.parametrize("blur", [PUBLISHED, LAWS[1]])
@pytest.mark.parametrize("rows", [slice(0, 1), slice(5, 30), slice(40, 64)])
def test_some_rows_have_the_costs_they_have_in_the_whole(blur: Any, rows: slice) -> None:
    pair = plane(120)
    whole = law_cost.level_costs([blur], pair.infocus, [pair.defocus], 50)
    some = law_cost.level_costs_by_rows([blur], pair.infocus, [pair.defocus], 50)
    assert np.array_equal(some(rows), whole[rows])
