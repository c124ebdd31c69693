from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.errors import InputError
from dfdbench.evaluation.map_files import write_depth


def test_depth_files_hold_the_depth(tmp_path: Path) -> None:
    depth = np.array([[0, 100.25], [255, 1.5]], np.float32)
    write_depth(tmp_path / "a.npy", depth)
    write_depth(tmp_path / "deep/a.png", depth)
    assert np.array_equal(np.load(tmp_path / "a.npy"), depth)
    read = np.asarray(cv2.imread(str(tmp_path / "deep/a.png"), cv2.IMREAD_UNCHANGED))
    assert (str(read.dtype), (read / 256).tolist()) == ("uint16", depth.tolist())
    with pytest.raises(InputError, match=r"\.npy, \.npz or \.png"):
        write_depth(tmp_path / "a.gif", depth)
    write_depth(tmp_path / "a.npz", depth, sigma=depth + 1)
    with np.load(tmp_path / "a.npz") as kept:
        assert np.array_equal(kept["depth"], depth)
        assert np.array_equal(kept["sigma"], depth + 1)
    depth[0, 0] = np.nan
    with pytest.raises(InputError, match=r"1 of 4 pixels have no answer.*\n.*\.npz"):
        write_depth(tmp_path / "a.png", depth)
