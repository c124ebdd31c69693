import cv2
import numpy as np
import pytest

from dfdbench.rig.board_outline import find_sides

CORNERS = np.array([[60.0, 50], [340, 70], [330, 300], [70, 310]])
MIDDLE = CORNERS.mean(axis=0)


def board(texture: np.ndarray) -> np.ndarray:
    inside = np.zeros((360, 400), np.uint8)
    cv2.fillPoly(inside, [CORNERS.astype(np.int32)], 1)
    image = np.where(inside > 0, texture, 40).astype(np.uint8)
    return np.repeat(image[..., np.newaxis], 3, axis=2)


def sides(shift: float) -> list[tuple[np.ndarray, np.ndarray]]:
    moved = CORNERS + shift
    return [(moved[n], moved[(n + 1) % 4]) for n in range(4)]


def distance_to(line: np.ndarray, side: int) -> float:
    ends = CORNERS[[side, (side + 1) % 4]]
    return float(np.abs(ends @ line[:2] + line[2]).max())


@pytest.mark.parametrize("shift", [0.0, 25.0, -40.0])
def test_the_sides_of_a_textured_board_are_found_from_afar(shift: float) -> None:
    texture = np.random.default_rng(0).integers(90, 230, (360, 400))
    found = find_sides(board(texture), sides(shift), MIDDLE + shift)
    for side, lines in enumerate(found):
        assert distance_to(lines[0], side) < 1.5
        # Distances grow inwards.
        assert MIDDLE @ lines[0][:2] + lines[0][2] > 0


def test_where_a_line_of_the_texture_is_clearer_the_side_is_among_the_candidates() -> None:
    texture = np.full((360, 400), 44)
    texture[:, 100:] = 200
    found = find_sides(board(texture), sides(0.0), MIDDLE)
    assert distance_to(found[3][0], 3) > 20
    assert min(distance_to(line, 3) for line in found[3]) < 2


def test_a_plain_image_has_no_sides() -> None:
    assert find_sides(np.full((360, 400, 3), 80, np.uint8), sides(0.0), MIDDLE) == [[], [], [], []]
