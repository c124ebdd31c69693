import numpy as np
import pytest
import xarray

from dfdbench.datasets.captures import Capture, ImageFacts, Role, capture_of
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Depth, Pair
from dfdbench.errors import InputError

SCALE = DepthScale(law="inverse", near=0.5, far=5.0)
METRES = Depth(axes=[], unknown=0, grows_with="nearness", unit="metres", scale=SCALE)


def test_metres_have_levels_and_two_images_of_a_stack_are_a_pair() -> None:
    images = np.stack([np.full((4, 5, 3), 257 * number, np.uint16) for number in range(3)])
    roles: tuple[Role, ...] = ("infocus", "defocus", "defocus")
    facts = ImageFacts(roles, focus_distance=np.array([np.nan, 1.0, 2.0]))
    depth = np.full((4, 5), 1.5, np.float32)
    depth[0, 0] = np.nan
    capture = Capture(Pair("Desk", ()), images, depth, facts, METRES)
    assert not capture.is_pair
    assert repr(capture) == "<Desk: 3 images of 5 x 4>"
    assert (capture.valid.sum(), capture.levels[0, 0]) == (19, 0)
    assert capture.levels[1, 1] == SCALE.to_levels(np.array([1.5]))[0]
    about = capture.stack.attrs
    assert (about["unit"], about["near"], about["far"]) == ("metres", 0.5, 5.0)
    pair = capture.two_of((0, 2))
    assert pair.is_pair
    assert (pair.infocus.max(), pair.defocus.max()) == (0, 2)
    again = Capture(Pair("Desk", ()), images.copy(), depth.copy(), facts, METRES)
    assert [pair, capture].index(again) == 1
    assert len({pair, capture, again}) == 2
    assert pair.stack["focus_distance"].values[1] == 2.0


def test_a_stack_in_metres_says_where_its_depths_end() -> None:
    images, dims = np.zeros((2, 4, 5, 3), np.uint8), ("image", "y", "x", "channel")
    ends: tuple[dict[str, float | None], ...] = (
        {},
        {"near": None, "far": 2},
        {"near": np.nan, "far": 2},
        {"near": 2, "far": 1},
    )
    for wrong in ends:
        stack = xarray.DataArray(images, dims=dims, attrs={"unit": "metres", **wrong})
        with pytest.raises(InputError, match="without ends of depth"):
            capture_of(stack)
    stack.attrs |= {"near": 1, "far": 2}
    assert capture_of(stack).about.ends == (1, 2)
