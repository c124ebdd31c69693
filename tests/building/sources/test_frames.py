import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.building.sources.frames import average_frames, decode, png_problems
from dfdbench.errors import SourceError
from tests.conftest import write_png


def test_frames_are_averaged_half_up() -> None:
    frames = [np.full((2, 2, 3), value, np.uint8) for value in (10, 10, 11, 11)]
    assert (average_frames(frames) == 11).all()
    frames[3][:] = 10
    assert (average_frames(frames) == 10).all()


def test_sound_files_have_no_problem_and_are_decoded(tmp_path: Path) -> None:
    image = np.random.default_rng(1).integers(0, 256, (20, 30, 3)).astype(np.uint8)
    path = tmp_path / "frame.png"
    write_png(path, image)
    assert png_problems([path], (20, 30)) == []
    # OpenCV writes blue first.
    assert np.array_equal(decode(path, cv2.IMREAD_COLOR_RGB), image[..., ::-1])


def test_all_that_is_wrong_with_files_is_told(tmp_path: Path) -> None:
    whole = tmp_path / "whole.png"
    write_png(whole, np.random.default_rng(2).integers(0, 256, (20, 30)).astype(np.uint8))
    cut, other, absent = tmp_path / "cut.png", tmp_path / "other.png", tmp_path / "absent.png"
    cut.write_bytes(whole.read_bytes()[:-20])
    other.write_bytes(b"GIF89a and a good deal more than twenty-four bytes")
    told = [
        (Path(problem.where).name, problem.what, problem.got)
        for problem in png_problems([absent, other, cut, whole], (30, 20))
    ]
    length = len(whole.read_bytes()) - 20
    assert told == [
        ("absent.png", "cannot read the file", "No such file or directory"),
        ("other.png", "not a PNG file", "bytes b'GIF89a a'"),
        ("cut.png", "PNG file is damaged", f"{length} bytes, cut short"),
        ("cut.png", "size differs", "20 x 30"),
        ("whole.png", "size differs", "20 x 30"),
    ]
    with pytest.raises(SourceError, match="PNG file is damaged"):
        decode(other, cv2.IMREAD_GRAYSCALE)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.png")
    (problem,) = png_problems([tmp_path / "a.png"], (2, 3))
    assert (problem.what, problem.got) == ("cannot read the file", "not a regular file")
    with pytest.raises(SourceError, match="not a regular file"):
        decode(tmp_path / "a.png", cv2.IMREAD_GRAYSCALE)
