import base64

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.report.pictures import depth_map, error_map, inline_svg, photo


def decoded(address: str) -> NDArray[np.uint8]:
    head, _, content = address.partition(",")
    assert head == "data:image/webp;base64"
    image = cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), cv2.IMREAD_COLOR_RGB)
    assert image is not None
    return np.asarray(image, np.uint8)


def test_a_photo_keeps_its_colours() -> None:
    image = np.zeros((32, 40, 3), np.uint8)
    image[..., 0] = 200
    assert np.abs(decoded(photo(image)).astype(int) - image).max() < 12


def test_unknown_depth_is_grey_and_no_error_is_white() -> None:
    depth = np.full((32, 32), 50.0)
    depth[:, :16] = np.nan
    assert decoded(depth_map(depth, 0, 100))[16, 4] == pytest.approx(191, abs=8)
    assert (decoded(error_map(np.zeros((32, 32))))[16, 16] > 235).all()


def test_a_flat_depth_map_is_drawn() -> None:
    assert decoded(depth_map(np.full((16, 16), 7.0), 7, 7)).shape == (16, 16, 3)


def test_a_figure_is_one_svg_element_named_for_who_cannot_see_it() -> None:
    figure = Figure()
    figure.subplots().set_title("a < b")
    text = inline_svg(figure, 'n "q" <x>')
    assert text.startswith("<svg")
    assert 'aria-label="n &quot;q&quot; &lt;x&gt;"' in text
    assert "a &lt; b" in text


@pytest.mark.parametrize("strange", ["\x00", "\x1b", "\ufffe"])
def test_characters_that_svg_cannot_hold_are_shown_as_replaced(strange: str) -> None:
    figure = Figure()
    figure.subplots().set_title(f"a{strange}b")
    text = inline_svg(figure, f"c{strange}d")
    assert "a\ufffdb" in text
    assert 'aria-label="c\ufffdd"' in text
