import numpy as np
import pytest

from dfdbench.errors import SourceError
from dfdbench.rig.board_rays import board_rays
from dfdbench.rig.geometry import Pose, Rig
from dfdbench.rig.lidar_files import read_beams
from dfdbench.simulation.board_scene import SimulatedScene


def test_rays_are_parted_where_the_board_ends() -> None:
    scene = SimulatedScene(3, pose=Pose())
    rays = board_rays(scene.scan(read_beams(), 0).astype(float), read_beams())
    assert not (rays.hit & rays.passed).any()
    places = rays.points - np.array([0, Rig().baseline, 0])
    # The plane is found to a millimetre, so the board's edge is where it is to less than two.
    beyond = (np.abs(places[..., :2]) - np.array(scene.board.size) / 2).max(axis=-1)
    assert beyond[rays.hit].max() < 0.002
    assert beyond[rays.passed].min() > -0.002
    assert rays.hit.sum() > 3000
    # All of them are where the board's plane is.
    assert np.abs(places[rays.hit][:, 2] - 1.5).max() < 0.01


def test_a_scan_without_a_board_is_refused() -> None:
    with pytest.raises(SourceError, match="sees no board"):
        board_rays(np.full((64, 2048), 5000.0), read_beams())
