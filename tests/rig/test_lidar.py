import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage

from dfdbench.errors import InputError
from dfdbench.rig.lidar import (
    Beams,
    align_columns,
    average_scans,
    fill_missing,
    median_cross,
    to_cartesian,
)
from dfdbench.rig.lidar_files import read_beams

images = hnp.arrays(np.float64, (20, 24), elements=st.integers(0, 255).map(float))


def test_missing_returns_do_not_pull_an_average_down() -> None:
    scans = [np.array([[1500, 0, 0, 7]]), np.array([[1502, 900, 0, 9]])]
    assert average_scans(scans).tolist() == [[1501, 900, 0, 8]]
    with pytest.raises(InputError, match="differ in shape"):
        average_scans([np.zeros((2, 3), np.int32), np.zeros((2, 4), np.int32)])


def test_equations_3_5_to_3_9_by_hand() -> None:
    beams = read_beams()
    x, y, z = to_cartesian(np.full((64, 2048), 2000.0), beams)
    # Beam 0: altitude 16.4486 degrees, azimuth index 17; measurement 1000 is column 1017.
    theta, phi = 2 * np.pi * (1017 - 1023.5) / 2048, np.deg2rad(16.4486)
    assert x[0, 1000] == pytest.approx(2000 * np.cos(theta) * np.cos(phi))
    assert y[0, 1000] == pytest.approx(-2000 * np.sin(theta) * np.cos(phi))
    assert z[0, 1000] == pytest.approx(2000 * np.sin(phi))
    # Beam 63, index -17: measurement 5 wraps to 2036.
    assert x[63, 5] == pytest.approx(
        2000 * np.cos(2 * np.pi * (2036 - 1023.5) / 2048) * np.cos(np.deg2rad(-16.8294))
    )
    assert np.sqrt(x**2 + y**2 + z**2) == pytest.approx(np.full((64, 2048), 2000.0))


def test_a_calibration_of_63_beams_is_refused() -> None:
    with pytest.raises(InputError, match="64 beams"):
        to_cartesian(np.zeros((64, 2048)), Beams(np.zeros(63), np.zeros(63), np.zeros(63, int)))


def test_aligned_columns_look_in_one_direction() -> None:
    beams = read_beams()
    x, y, _ = to_cartesian(np.ones((64, 2048)), beams)
    direction = align_columns(np.arctan2(y, x), beams)
    assert np.abs(np.diff(direction, axis=0)).max() < 1e-12


@settings(max_examples=40)
@given(images, st.sampled_from([3, 7, 13]))
def test_the_median_is_that_of_a_plain_filter(image: np.ndarray, length: int) -> None:
    down = ndimage.median_filter(image, size=(length, 1), mode="reflect")
    both = ndimage.median_filter(down, size=(1, length), mode="reflect")
    assert (median_cross(image, length) == both).all()


def test_the_median_keeps_a_straight_edge_and_drops_a_speck() -> None:
    image = np.full((30, 30), 250.0)
    image[:, 12:] = 150.0
    expected = image.copy()
    image[10, 20] = 0.0
    assert (median_cross(image) == expected).all()


def test_filling_takes_the_nearest_value_and_needs_one() -> None:
    values = np.array([[1.0, 0, 0, 0, 5.0]])
    assert fill_missing(values, values > 0).tolist() in ([[1, 1, 1, 5, 5]], [[1, 1, 5, 5, 5]])
    with pytest.raises(InputError, match="saw nothing"):
        fill_missing(values, np.zeros(values.shape, bool))
