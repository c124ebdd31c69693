import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import correlate

from dfdbench.blur.formation import decode, encode
from dfdbench.blur.law import BlurLaw, noise_at
from dfdbench.methods.law_cost import MISFIT_STEPS, blurred_by, law_cost, law_misfits

SIGMAS = (2.4, 1.1, 0.4, 0.7, 1.6)


def pair() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    random = np.random.default_rng(1)
    infocus = random.integers(0, 256, (21, 26, 3)).astype(np.uint8)
    defocus = cv2.GaussianBlur(infocus, (0, 0), 1) + random.integers(-2, 3, infocus.shape)
    return infocus, np.clip(defocus, 0, 255).astype(np.uint8)


def blurred_at(law: BlurLaw, infocus: NDArray[np.uint8], level: int) -> NDArray[np.float64]:
    light = decode(infocus.astype(np.float64)) if law.linear else infocus.astype(np.float64)
    kernel = law.kernels()[level][..., np.newaxis]
    blurred = correlate(light, kernel, mode="nearest")
    return encode(blurred) if law.linear else blurred


LAWS = [
    BlurLaw(SIGMAS, kernel_size=15, noise=(2.0,)),
    BlurLaw(SIGMAS, exponent=8.0, kernel_size=15, noise=(3.0, 1.0), infocus_noise=0.8),
    BlurLaw(SIGMAS, exponent=32.0, kernel_size=15, noise=(2.0,), linear=True),
    BlurLaw(SIGMAS, kernel_size=15, noise=(2.0,), gain=1.1, offset=2.0),
]


@pytest.mark.parametrize("law", LAWS)
def test_costs_and_misfits_equal_the_definition(law: BlurLaw) -> None:
    infocus, defocus = pair()
    aim = (defocus - law.offset) / law.gain
    noise = noise_at(law.noise, aim)
    spread = 1 + law.infocus_noise**2 * np.square(law.kernels()).sum(axis=(1, 2))
    costs, misfits = np.empty((2, 21, 26, len(SIGMAS)))
    for level in range(len(SIGMAS)):
        residual = aim - blurred_at(law, infocus, level)
        nats = np.square(residual / noise).sum(axis=2) / (2 * spread[level])
        costs[..., level] = 4 * (nats + 1.5 * math.log(spread[level]))
        bound = np.sqrt(3 * spread[level]) * noise
        misfits[..., level] = np.sqrt(
            np.square(np.maximum(np.abs(residual) - bound, 0)).sum(axis=2)
        )
    blurred = blurred_by(law, infocus, defocus)
    unary, offset = law_cost(blurred, 4, 60000)
    least = costs.min(axis=2, keepdims=True)
    assert np.abs(unary - np.minimum(costs - least, 60000)).max() <= 2 + 0.002 * costs.max()
    assert offset == pytest.approx(least.sum(), rel=0.002)
    assert np.abs(law_misfits(blurred) / MISFIT_STEPS - misfits).max() < 0.1
    for level in range(len(SIGMAS)):
        assert np.abs(blurred.of_level(level) - blurred_at(law, infocus, level)).max() < 0.1


def test_only_the_levels_in_question_are_worked_out() -> None:
    law = LAWS[1]
    whole = law_cost(blurred_by(law, *pair()), 4, 60000)[0].astype(int)
    some = law_cost(blurred_by(law, *pair(), np.array([1, 3])), 4, 60000)[0].astype(int)
    difference = whole[..., [1, 3]] - some
    assert np.abs(difference[..., 0] - difference[..., 1]).max() <= 1
