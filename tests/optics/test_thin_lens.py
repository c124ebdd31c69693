import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.errors import InputError
from dfdbench.optics.thin_lens import ThinLens

EXAMPLE = ThinLens(3.7, 9.6e-3, 0.5, 4.8e-6)  # Table 2.1

lenses = st.builds(
    ThinLens, st.floats(1, 22), st.floats(2e-3, 0.2), st.floats(0.3, 50), st.floats(1e-6, 2e-5)
)


def test_the_example_of_table_2_1_gives_the_curve_of_figure_2_5() -> None:
    # By hand: d_o f^2 / (n (d_o - f)) = 2.5396e-5 m^2, over 4.8 um: 5.2908 pixels a dioptre.
    distance = np.array([0.3, 0.4, 0.5, 0.6, 1.0, 2.0, 4.0])
    expected = 5.29077 * np.abs(1 / 0.5 - 1 / distance)
    assert EXAMPLE.blur_radius(distance) / 4.8e-6 == pytest.approx(expected, rel=1e-5)
    assert EXAMPLE.max_blur_radius() / 4.8e-6 == pytest.approx(10.58154, rel=1e-5)
    assert EXAMPLE.quantised_blur_radius(distance).tolist() == [8, 3, 0, 2, 6, 8, 10]


@given(lenses, st.floats(1.0, 1000))
def test_far_blur_grows_towards_its_limit(lens: ThinLens, times: float) -> None:
    distance = lens.focus_distance * np.array([1, times, times + 1, np.inf])
    blur = lens.blur_radius_far(distance)
    assert (np.diff(blur) >= 0).all()
    assert blur[-1] == pytest.approx(lens.max_blur_radius())
    assert blur == pytest.approx(lens.blur_radius(distance))


@given(lenses)
def test_the_ends_of_the_depth_of_field_are_blurred_by_one_pixel(lens: ThinLens) -> None:
    near, far = lens.depth_of_field()
    assert near < lens.focus_distance < far
    assert lens.blur_radius(near) == pytest.approx(lens.pixel_size)
    if np.isfinite(far):
        assert lens.blur_radius_far(far) == pytest.approx(lens.pixel_size, rel=1e-6)


@given(lenses)
def test_beyond_the_hyperfocal_distance_infinity_is_sharp(lens: ThinLens) -> None:
    reach = lens.hyperfocal_distance()
    beyond = ThinLens(lens.f_number, lens.focal_length, reach * 1.001, lens.pixel_size)
    before = ThinLens(lens.f_number, lens.focal_length, reach * 0.999, lens.pixel_size)
    assert np.isinf(beyond.depth_of_field()[1])
    assert np.isfinite(before.depth_of_field()[1])


@given(lenses, st.floats(1.0, 20))
def test_the_depth_resolution_is_one_pixel_of_blur(lens: ThinLens, times: float) -> None:
    distance = lens.focus_distance * times
    step = float(lens.depth_resolution(distance))
    if np.isfinite(step) and step < 1e6:
        near, far = lens.blur_radius([distance, distance + step]) / lens.pixel_size
        assert far - near == pytest.approx(1, rel=1e-5)
    elif np.isinf(step):
        grown = lens.max_blur_radius() - float(lens.blur_radius(distance))
        assert grown / lens.pixel_size <= 1 + 1e-6


def test_impossible_lenses_are_refused_with_every_reason() -> None:
    with pytest.raises(InputError) as said:
        ThinLens(-1, 9.6e-3, 0.5, 0)
    assert [problem.where for problem in said.value.problems] == ["f_number", "pixel_size"]
    with pytest.raises(InputError, match="no real image"):
        ThinLens(3.7, 0.5, 0.4, 4.8e-6)
    with pytest.raises(InputError, match="not positive"):
        EXAMPLE.blur_radius([0.5, 0.0])


def test_the_sigma_is_a_quarter_of_the_disks_width_and_variances_subtract() -> None:
    lens = ThinLens(2.0, 0.05, 1.05, 1e-4)
    # 25 mm * (55.5556 - 52.5) / 55.5556: see a point at 0.5 m through Eq. 2.2.
    assert lens.blur_sigma(0.5) == pytest.approx(13.75 / 4)
    assert lens.blur_sigma(1.05) == pytest.approx(0, abs=1e-12)
    stopped_down = ThinLens(8.0, 0.05, 1.05, 1e-4)
    both = lens.blur_sigma(0.5, infocus_f_number=8.0) ** 2 + stopped_down.blur_sigma(0.5) ** 2
    assert both == pytest.approx(lens.blur_sigma(0.5) ** 2)
    for f_number in (2.0, 1.4):
        with pytest.raises(InputError, match="no smaller aperture"):
            lens.blur_sigma(0.5, f_number)
