from pathlib import Path

import numpy as np
import pytest

from dfdbench.errors import SourceError
from dfdbench.rig.registration_file import read_registration, write_registration

CORNERS = np.array([[500.0, 300], [1200, 300], [1200, 1000], [500, 1000]])
MATRIX = np.array([[0.97, 0.02, -500.0], [-0.01, 1.02, -310.0], [1e-5, -2e-5, 1.0]])


def test_what_is_written_is_read_to_a_hundredth_of_a_pixel(tmp_path: Path) -> None:
    path = tmp_path / "registration.toml"
    write_registration(path, MATRIX, CORNERS, "by hand")
    assert read_registration(path) == pytest.approx(MATRIX, rel=2e-3, abs=2e-6)
    assert "# by hand" in path.read_text()


def test_a_point_that_a_person_moves_moves_the_fit(tmp_path: Path) -> None:
    path = tmp_path / "registration.toml"
    shift = np.array([[1.0, 0, 5], [0, 1, -7], [0, 0, 1]])
    write_registration(path, shift, CORNERS, "")
    path.write_text(path.read_text().replace("image = [505.00, 293.00]", "image = [525.00, 293]"))
    moved = read_registration(path) @ np.array([500.0, 300, 1])
    assert moved[:2] / moved[2] == pytest.approx([525, 293])


def test_a_matrix_may_be_given_outright(tmp_path: Path) -> None:
    path = tmp_path / "registration.toml"
    path.write_text(f"matrix = {MATRIX.tolist()}\n")
    assert (read_registration(path) == MATRIX).all()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "too few pairs"),
        ("matrix = [[1, 2], [3, 4]]", "field is missing"),
        ("matrix = [[0, 0, 0], [0, 0, 0], [0, 0, 0]]", "not a projective matrix"),
        ("[[pairs]]\nlidar = [1, 2]\nimage = [1]\n" * 4, "field is missing"),
        ("[[pairs]]\nlidar = [1, 2]\nimage = [1, 2]\n" * 4, "share a point"),
        ("pairs = ", "cannot read"),
    ],
)
def test_a_file_that_gives_no_transform_is_told(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "registration.toml"
    path.write_text(text)
    with pytest.raises(SourceError, match=told):
        read_registration(path)
    with pytest.raises(SourceError, match="cannot read"):
        read_registration(tmp_path / "none.toml")


def test_a_file_nested_too_deep_is_told(tmp_path: Path) -> None:
    (tmp_path / "deep.toml").write_text("matrix = " + "[" * 3000)
    with pytest.raises(SourceError, match="nested too deep"):
        read_registration(tmp_path / "deep.toml")
