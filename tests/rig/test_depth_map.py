import numpy as np

from dfdbench.rig.depth_map import depth_image, in_range, to_levels, upsample, warp
from dfdbench.rig.lidar import align_columns, crop_columns, to_cartesian
from dfdbench.rig.lidar_files import read_beams


def flat_wall(distance: float) -> np.ndarray:
    """Ranges of a wall straight ahead, at X = distance in mm; nothing behind the LIDAR."""
    beams = read_beams()
    ahead, _, _ = to_cartesian(np.ones((64, 2048)), beams)
    return np.where(ahead > 0.2, distance / np.maximum(ahead, 0.2), 0.0)


def test_levels_are_centimetres_rounded_down() -> None:
    distance = np.array([1499.999, 1500, 1509.99, 2549.9, 2550, 9000])
    assert to_levels(distance).tolist() == [149, 150, 150, 254, 255, 255]
    assert in_range(distance).tolist() == [True] * 4 + [False] * 2


def test_six_steps_of_upsampling_keep_a_plane_within_a_level() -> None:
    plane = np.floor(np.linspace(150, 220, 60))[np.newaxis, :].repeat(20, axis=0)
    levels, valid = upsample(plane, np.ones(plane.shape, bool))
    assert levels.shape == (360, 360)
    assert valid.all()
    expected = plane[0].repeat(6)
    assert np.abs(levels - expected)[:, 12:-12].max() <= 1


def test_a_missing_return_stays_missing_and_smears_nowhere() -> None:
    ranges, beams = flat_wall(1500.0), read_beams()
    hole = np.zeros((64, 2048), bool)
    hole[30:34, 1020:1030] = True
    levels, valid = depth_image(np.where(hole, 0, ranges), beams)
    aligned = crop_columns(align_columns(hole.astype(float), beams)) > 0
    assert (valid != aligned.repeat(18, axis=0).repeat(6, axis=1)).all()
    assert np.isin(levels, [149, 150]).all()


def test_what_lies_beyond_the_levels_is_not_valid() -> None:
    _, valid = depth_image(flat_wall(2600.0), read_beams())
    assert not valid.any()
    _, valid = depth_image(flat_wall(2500.0), read_beams())
    assert valid.all()


def test_warping_moves_levels_and_validity_together() -> None:
    levels = np.arange(100, 130, dtype=float).reshape(5, 6)
    valid = np.ones((5, 6), bool)
    valid[2, 3] = False
    shift = np.array([[1.0, 0, 1], [0, 1, 2], [0, 0, 1]])
    moved, seen = warp(levels, valid, shift, (5, 6))
    assert (moved[2:, 1:] == np.where(valid, levels, 0)[:3, :5]).all()
    assert not seen[:2].any()
    assert not seen[:, 0].any()
    assert not seen[4, 4]
    assert (moved[~seen] == 0).all()
