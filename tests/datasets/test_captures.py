import numpy as np
import pytest

from dfdbench.datasets.captures import Capture, ImageFacts, Role, eight_bits
from dfdbench.datasets.depth_scale import DepthScale
from dfdbench.datasets.manifest import Depth, Pair
from dfdbench.errors import InputError

SCALE = DepthScale(law="inverse", near=0.5, far=5.0)
METRES = Depth(axes=[], unknown=0, grows_with="nearness", unit="metres", scale=SCALE)


@pytest.fixture
def capture() -> Capture:
    images = np.stack([np.full((4, 5, 3), 257 * number, np.uint16) for number in range(3)])
    roles: tuple[Role, ...] = ("infocus", "defocus", "defocus")
    distances = np.array([np.nan, 1.0, 2.0])
    facts = ImageFacts(roles, distances, focus_depth=distances, focal_length=np.array(0.05))
    depth = np.full((4, 5), 1.5, np.float32)
    depth[0, 0] = np.nan
    return Capture(Pair("Desk", ()), images, depth, facts, METRES)


def test_a_stack_says_what_is_known_of_its_images(capture: Capture) -> None:
    stack = capture.stack
    assert stack.dims == ("image", "y", "x", "channel")
    assert stack["role"].values.tolist() == ["infocus", "defocus", "defocus"]
    assert stack["focus_distance"].values[1:].tolist() == [1.0, 2.0]
    assert np.isnan(stack["f_number"].values).all()
    assert (stack.attrs["unit"], stack.attrs["near"], stack.attrs["far"]) == ("metres", 0.5, 5.0)
    assert stack.attrs["focal_length"] == 0.05
    assert np.isnan(stack.attrs["pixel_pitch"])


def test_metres_have_levels_and_unknown_depth_is_nan(capture: Capture) -> None:
    assert not capture.is_pair
    assert capture.valid.sum() == 19
    assert capture.levels[0, 0] == 0
    assert capture.levels[1, 1] == SCALE.to_levels(np.array([1.5]))[0]


def test_two_of_its_images_are_a_pair(capture: Capture) -> None:
    pair = capture.two_of((0, 2))
    assert pair.is_pair
    assert pair.infocus.max() == 0
    assert (pair.defocus == 2).all()
    assert pair.stack["focus_distance"].values[1] == 2.0


def test_16_bits_become_8_and_a_role_that_is_not_there_is_refused() -> None:
    assert eight_bits(np.array([0, 128, 129, 65535], np.uint16)).tolist() == [0, 0, 1, 255]
    image, depth = np.zeros((1, 2, 2, 3), np.uint8), np.zeros((2, 2), np.float32)
    only = Capture(Pair("Desk", ()), image, depth, ImageFacts(("defocus",)))
    with pytest.raises(InputError, match="no infocus image"):
        _ = only.infocus
