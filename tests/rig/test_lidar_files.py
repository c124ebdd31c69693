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
        (b"", "no header"),
        (np.array([64, 2048], "<u4").tobytes() + b"\0" * 400, "disagrees with the file"),
        (np.array([1, 2], "<u4").tobytes() + b"\0" * 12, "disagrees with the file"),
        (np.array([1, 2], ">u4").tobytes() + np.array([7, 8], ">i4").tobytes(), "big-endian"),
        (np.array([1, 2, 7], "<u4").tobytes() + np.array([-8], "<i4").tobytes(), "not ranges"),
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


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("beam,altitude_deg,azimuth_deg,azimuth_index\n0,16.5,3.1,18\n1,x,0,0\n", "line 3"),
        ("beam,altitude_deg\n0,1\n", "no rows with the columns"),
        ("beam,altitude_deg,azimuth_deg,azimuth_index\n", "no rows with the columns"),
        ("altitude_deg,azimuth_deg,azimuth_index\nnan,3.1,18\n", "not degrees up to 90"),
        ("altitude_deg,azimuth_deg,azimuth_index\n900,3.1,18\n", "not degrees up to 90"),
        (
            f"altitude_deg,azimuth_deg,azimuth_index\n1,2,{10**30}\n1,2,{10**30}\n",
            r"not whole numbers up to 65536 \(.*: line 2, and 1 more lines\)",
        ),
    ],
)
def test_a_damaged_calibration_is_reported(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "beams.csv"
    path.write_text(text)
    with pytest.raises(SourceError, match=told):
        read_beams(path)
    with pytest.raises(SourceError, match="cannot read"):
        read_beams(tmp_path / "none.csv")


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
