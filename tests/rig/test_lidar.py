from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage

from dfdbench.errors import SourceError
from dfdbench.rig import lidar

images = hnp.arrays(np.float64, (20, 24), elements=st.integers(0, 255).map(float))


def test_equations_3_5_to_3_9_by_hand() -> None:
    x, y, z = lidar.to_cartesian(np.full((64, 2048), 2000.0), lidar.read_beams())
    # Beam 0: altitude 16.4486 degrees, azimuth index 17; measurement 1000 is column 1017.
    theta, phi = 2 * np.pi * (1017 - 1023.5) / 2048, np.deg2rad(16.4486)
    assert x[0, 1000] == pytest.approx(2000 * np.cos(theta) * np.cos(phi))
    assert y[0, 1000] == pytest.approx(-2000 * np.sin(theta) * np.cos(phi))
    assert z[0, 1000] == pytest.approx(2000 * np.sin(phi))
    # Beam 63, index -17: measurement 5 wraps to 2036.
    theta, phi = 2 * np.pi * (2036 - 1023.5) / 2048, np.deg2rad(-16.8294)
    assert x[63, 5] == pytest.approx(2000 * np.cos(theta) * np.cos(phi))
    assert np.sqrt(x**2 + y**2 + z**2) == pytest.approx(np.full((64, 2048), 2000.0))


def test_aligned_columns_look_in_one_direction() -> None:
    beams = lidar.read_beams()
    x, y, _ = lidar.to_cartesian(np.ones((64, 2048)), beams)
    direction = lidar.align_columns(np.arctan2(y, x), beams)
    assert np.abs(np.diff(direction, axis=0)).max() < 1e-12


@settings(max_examples=40)
@given(images, st.sampled_from([3, 7, 13]))
def test_the_median_is_that_of_a_plain_filter(image: np.ndarray, length: int) -> None:
    down = ndimage.median_filter(image, size=(length, 1), mode="reflect")
    both = ndimage.median_filter(down, size=(1, length), mode="reflect")
    assert (lidar.median_cross(image, length) == both).all()


def flat_wall(distance: float) -> np.ndarray:
    """Ranges of a wall straight ahead, at X = distance in mm; nothing behind the LIDAR."""
    ahead, _, _ = lidar.to_cartesian(np.ones((64, 2048)), lidar.read_beams())
    return np.where(ahead > 0.2, distance / np.maximum(ahead, 0.2), 0.0)


def test_six_steps_of_upsampling_keep_a_plane_within_a_level() -> None:
    plane = np.floor(np.linspace(150, 220, 60))[np.newaxis, :].repeat(20, axis=0)
    levels, valid = lidar.upsample(plane, np.ones(plane.shape, bool))
    assert levels.shape == (360, 360)
    assert valid.all()
    assert np.abs(levels - plane[0].repeat(6))[:, 12:-12].max() <= 1


def test_a_missing_return_stays_missing_and_smears_nowhere() -> None:
    ranges, beams = flat_wall(1500.0), lidar.read_beams()
    hole = np.zeros((64, 2048), bool)
    hole[30:34, 1020:1030] = True
    levels, valid = lidar.depth_image(np.where(hole, 0, ranges), beams)
    aligned = lidar.crop_columns(lidar.align_columns(hole.astype(float), beams)) > 0
    assert (valid != aligned.repeat(18, axis=0).repeat(6, axis=1)).all()
    assert np.isin(levels, [149, 150]).all()


def test_what_lies_beyond_the_levels_is_not_valid() -> None:
    _, valid = lidar.depth_image(flat_wall(2600.0), lidar.read_beams())
    assert not valid.any()
    _, valid = lidar.depth_image(flat_wall(2500.0), lidar.read_beams())
    assert valid.all()


def test_warping_moves_levels_and_validity_together() -> None:
    levels = np.arange(100, 130, dtype=float).reshape(5, 6)
    valid = np.ones((5, 6), bool)
    valid[2, 3] = False
    shift = np.array([[1.0, 0, 1], [0, 1, 2], [0, 0, 1]])
    moved, seen = lidar.warp(levels, valid, shift, (5, 6))
    assert (moved[2:, 1:] == np.where(valid, levels, 0)[:3, :5]).all()
    assert not seen[:2].any()
    assert not seen[:, 0].any()
    assert not seen[4, 4]
    assert (moved[~seen] == 0).all()


scans = hnp.arrays(np.int32, hnp.array_shapes(min_dims=2, max_dims=2), elements=st.integers(0, 9))


@given(scans)
def test_what_it_writes_it_reads(
    tmp_path_factory: pytest.TempPathFactory, ranges: np.ndarray
) -> None:
    path = tmp_path_factory.mktemp("scan") / "lidar_rng_00000.bin"
    lidar.write_ranges(path, ranges)
    assert (lidar.read_ranges(path) == ranges).all()
    np.save(path.with_suffix(".npy"), ranges)
    assert (lidar.read_ranges(path.with_suffix(".npy")) == ranges).all()


def test_the_layout_is_rows_columns_then_little_endian_ranges(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(bytes([1, 0, 0, 0, 2, 0, 0, 0, 0xDC, 5, 0, 0, 1, 0, 0, 0]))
    assert lidar.read_ranges(path).tolist() == [[1500, 1]]


def test_a_damaged_scan_is_told(tmp_path: Path) -> None:
    path = tmp_path / "lidar_rng_00000.bin"
    for content, said in (
        (b"", "no header"),
        (np.array([64, 2048], "<u4").tobytes() + b"\0" * 400, "disagrees with the file"),
        (np.array([1, 2], "<u4").tobytes() + b"\0" * 12, "disagrees with the file"),
        (np.array([1, 2], ">u4").tobytes() + np.array([7, 8], ">i4").tobytes(), "big-endian"),
        (np.array([1, 2, 7], "<u4").tobytes() + np.array([-8], "<i4").tobytes(), "not ranges"),
        (np.array([0, 0], "<u4").tobytes(), "not ranges"),
    ):
        path.write_bytes(content)
        with pytest.raises(SourceError, match=said) as error:
            lidar.read_ranges(path)
        assert str(path) in str(error.value)
    with pytest.raises(SourceError, match="cannot read"):
        lidar.read_ranges(tmp_path / "none.bin")


def test_an_array_must_hold_ranges_as_its_head_says(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    # The second would be another range in 32 bits.
    for array, told in ((np.zeros(2), "whole numbers"), (np.full(2, 2**32 + 15), "not ranges")):
        np.save(path, array[np.newaxis])
        with pytest.raises(SourceError, match=told):
            lidar.read_ranges(path)
    np.save(path, np.ones((64, 64), np.int64))
    content = path.read_bytes()
    for shape in ("(99999999, 99999999)", "(2, 9", "(2, -9)", None):
        head = f"{{'descr': '<i8', 'fortran_order': False, 'shape': {shape}, }}".encode()
        whole = content[:10] + head.ljust(117) + b"\n" + content[128:]
        path.write_bytes(whole if shape else b"no array")
        with pytest.raises(SourceError, match="not a NumPy array"):
            lidar.read_ranges(path)


def test_a_damaged_calibration_is_reported(tmp_path: Path) -> None:
    head = "altitude_deg,azimuth_deg,azimuth_index\n"
    more = r"not whole numbers up to 65536 \(.*: line 2, and 1 more lines\)"
    path = tmp_path / "beams.csv"
    for text, said in (
        (f"beam,{head}0,16.5,3.1,18\n1,x,0,0\n", "line 3"),
        ("beam,altitude_deg\n0,1\n", "no rows with the columns"),
        (f"beam,{head}", "no rows with the columns"),
        (f"{head}nan,3.1,18\n", "not degrees up to 90"),
        (f"{head}900,3.1,18\n", "not degrees up to 90"),
        (f"{head}1,2,{10**30}\n1,2,{10**30}\n", more),
    ):
        path.write_text(text)
        with pytest.raises(SourceError, match=said):
            lidar.read_beams(path)
    with pytest.raises(SourceError, match="cannot read"):
        lidar.read_beams(tmp_path / "none.csv")
