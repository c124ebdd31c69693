import base64

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.system.thumbnails import depth_map, gallery, photograph


def decoded(address: str) -> NDArray[np.uint8]:
    head, _, content = address.partition(",")
    assert head == "data:image/webp;base64"
    image = cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), cv2.IMREAD_COLOR_RGB)
    assert image is not None
    return np.asarray(image, np.uint8)


def test_a_photograph_keeps_its_colours_and_its_shape() -> None:
    red = np.zeros((300, 400, 3), np.uint8)
    red[..., 0] = 200
    small = decoded(photograph(red, "red")[0])
    assert small.shape == (120, 160, 3)
    np.testing.assert_allclose(small[60, 80], (200, 0, 0), atol=12)


def test_a_depth_map_is_bright_where_near_and_grey_where_unknown() -> None:
    depth = np.zeros((90, 160), np.float32)
    depth[:, 60:] = 255
    valid = np.ones((90, 160), bool)
    valid[:, 110:] = False
    small = decoded(depth_map(depth, valid, "depth")[0])
    assert small[45, 20].sum() < small[45, 85].sum()
    np.testing.assert_allclose(small[45, 140], 191, atol=12)


def test_captions_are_text_and_no_markup() -> None:
    assert "<b>" not in gallery([[("data:,", "<b>")]])
