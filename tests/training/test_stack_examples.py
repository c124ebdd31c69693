from pathlib import Path

import numpy as np
import pytest

from dfdbench.datasets.captures import Capture, ImageFacts
from dfdbench.datasets.manifest import Pair
from dfdbench.training import stack_examples
from dfdbench.training.stack_examples import room_stacks, stack_of


def test_a_capture_s_images_are_put_in_order_of_the_focus() -> None:
    images = np.stack([np.full((4, 6, 3), grey, np.uint8) for grey in (9, 50, 10, 30)])
    facts = ImageFacts(
        ("infocus", "defocus", "defocus", "defocus"),
        focus_depth=np.array([np.nan, 200.0, 20.0, 90.0]),
    )
    depth = np.full((4, 6), 80, np.float32)
    depth[0] = np.nan
    capture = Capture(Pair("Desk", ()), images, depth, facts)
    stack = stack_of(capture)
    assert stack.images[:, 0, 0, 0].tolist() == [10, 30, 50]
    assert stack.places.tolist() == [20, 90, 200]
    np.testing.assert_array_equal(stack.truth, depth)


@pytest.mark.slow
def test_rooms_are_made_once_and_are_the_same_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stack_examples, "CAMERAS", 2)
    monkeypatch.setattr(stack_examples, "_RAYS", 1)
    done: list[int] = []
    made = room_stacks(tmp_path, lambda camera, cameras: done.append(camera))
    assert done == [1, 2]
    (tmp_path / "stack-01.npz").unlink()
    times = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    again = room_stacks(tmp_path)
    assert times.items() <= {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}.items()
    for name, (one,) in made.items():
        (two,) = again[name]
        np.testing.assert_array_equal(one.images, two.images)
        np.testing.assert_array_equal(one.truth, two.truth)
        assert (np.diff(one.places) > 0).all()
        assert one.images.shape[1:3] == one.truth.shape
        # Rooms reach from 0.6 to 6 metres.
        assert 1 / 6.5 < np.nanmin(one.truth) < np.nanmax(one.truth) < 1 / 0.55
