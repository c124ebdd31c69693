import numpy as np

from dfdbench.blur import light
from dfdbench.blur.synthesis import rounded


def test_srgb_s_curve_and_its_inverse() -> None:
    grey = np.arange(256.0)
    assert np.allclose(light.encode(light.decode(grey)), grey, atol=1e-9)
    # From the standard's tables: a linear 18 % is grey level 118, and the curve is one piece.
    assert round(float(light.encode(np.array([0.18]))[0])) == 118
    assert np.abs(np.diff(light.encode(np.linspace(0.003, 0.0033, 99)))).max() < 0.02


def test_the_nearest_grey_level_is_found_to_the_last_bit() -> None:
    least = light._least_light()[0][:-1]
    random = np.random.default_rng(0).uniform(-0.1, 1.1, 100_000)
    for found in (random, np.square(random), least, np.nextafter(least, 0), light.LINEAR):
        expected = rounded(light.encode(found))
        assert np.array_equal(light.photographed(found), expected)
