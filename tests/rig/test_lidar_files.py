from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dfdbench.errors import SourceError
from dfdbench.rig.lidar_files import read_beams, read_ranges, write_ranges

scans = hnp.arrays(np.int32, hnp.array_shapes(min_dims=2, max_dims=2), elements=st.integers(0, 9))


@given(scans)
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, ranges: np.ndarray
) -> None:
    path = tmp_path_factory.mktemp("scan") / "lidar_rng_00000.bin"
    write_ranges(path, ranges)
    assert (read_ranges(path) == ranges).all()
    np.save(path.with_suffix(".npy"), ranges)
    assert (read_ranges(path.with_suffix(".npy")) == ranges).all()


def test_the_layout_is_rows_columns_then_little_endian_ranges(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(bytes([1, 0, 0, 0, 2, 0, 0, 0, 0xDC, 5, 0, 0, 1, 0, 0, 0]))
    assert read_ranges(path).tolist() == [[1500, 1]]


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "cut short"),
        (np.array([64, 2048], "<u4").tobytes() + b"\0" * 400, "header disagrees"),
        (np.array([1, 2], "<u4").tobytes() + b"\0" * 12, "header disagrees"),
        (np.array([1, 2], ">u4").tobytes() + np.array([7, 8], ">i4").tobytes(), "big-endian"),
        (np.array([1, 2, 7], "<u4").tobytes() + np.array([-8], "<i4").tobytes(), "range of -8"),
        (np.array([0, 0], "<u4").tobytes(), "not ranges"),
    ],
)
def test_a_damaged_scan_is_told(tmp_path: Path, content: bytes, told: str) -> None:
    path = tmp_path / "lidar_rng_00000.bin"
    path.write_bytes(content)
    with pytest.raises(SourceError, match=told) as error:
        read_ranges(path)
    assert str(path) in str(error.value)


def test_an_array_must_hold_ranges(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((2, 2)))
    with pytest.raises(SourceError, match="whole numbers"):
        read_ranges(tmp_path / "a.npy")
    (tmp_path / "b.npy").write_bytes(b"no array")
    with pytest.raises(SourceError, match="not a NumPy array"):
        read_ranges(tmp_path / "b.npy")
    with pytest.raises(SourceError, match="cannot read"):
        read_ranges(tmp_path / "none.bin")


def test_a_calibration_of_ones_own(tmp_path: Path) -> None:
    path = tmp_path / "beams.csv"
    path.write_text("beam,altitude_deg,azimuth_deg,azimuth_index\n0,16.5,3.1,18\n1,x,0,0\n")
    with pytest.raises(SourceError, match="line 3"):
        read_beams(path)
    path.write_text("beam,altitude_deg\n0,1\n")
    with pytest.raises(SourceError, match="azimuth_deg, azimuth_index absent"):
        read_beams(path)
    path.write_text("beam,altitude_deg,azimuth_deg,azimuth_index\n")
    with pytest.raises(SourceError, match="no beam"):
        read_beams(path)
    with pytest.raises(SourceError, match="cannot read"):
        read_beams(tmp_path / "none.csv")


@pytest.mark.parametrize("altitude", ["nan", "900"])
def test_beams_that_point_nowhere_are_told(tmp_path: Path, altitude: str) -> None:
    path = tmp_path / "beams.csv"
    path.write_text(f"beam,altitude_deg,azimuth_deg,azimuth_index\n0,{altitude},3.1,18\n")
    with pytest.raises(SourceError, match="degrees, 90 at most"):
        read_beams(path)


def test_an_index_beyond_any_scan_is_told(tmp_path: Path) -> None:
    path = tmp_path / "beams.csv"
    path.write_text(f"beam,altitude_deg,azimuth_deg,azimuth_index\n0,1,2,{10**30}\n")
    with pytest.raises(SourceError, match="whole numbers, 65536 at most"):
        read_beams(path)


def test_a_range_too_large_for_its_type_turns_into_no_other(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.full((2, 2), 2**32 + 1500))
    with pytest.raises(SourceError, match="not ranges"):
        read_ranges(tmp_path / "a.npy")


@pytest.mark.parametrize("shape", ["(99999999, 99999999)", "(2, 9", "(2, -9)"])
def test_a_head_that_claims_what_the_file_does_not_hold(tmp_path: Path, shape: str) -> None:
    np.save(tmp_path / "a.npy", np.ones((64, 64), np.int64))
    content = (tmp_path / "a.npy").read_bytes()
    head = f"{{'descr': '<i8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    (tmp_path / "a.npy").write_bytes(content[:10] + head.ljust(117) + b"\n" + content[128:])
    with pytest.raises(SourceError, match="not a NumPy array"):
        read_ranges(tmp_path / "a.npy")
