import base64

import cv2
import numpy as np

from dfdbench.system.data_address import webp_address


def test_an_image_comes_back_with_its_colours() -> None:
    image = np.zeros((20, 30, 3), np.uint8)
    image[..., 0] = 200
    text = webp_address(image, 100)
    content = np.frombuffer(base64.b64decode(text.partition(",")[2]), np.uint8)
    back = cv2.imdecode(content, cv2.IMREAD_COLOR)
    assert back is not None
    assert back.shape == image.shape
    # OpenCV reads blue first.
    assert np.abs(back[..., ::-1].astype(int) - image).max() < 12
