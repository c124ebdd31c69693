from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dfdbench.building.png import decode_depth, decode_image, png_size
from dfdbench.errors import SourceError

IMAGE = np.random.default_rng(0).integers(0, 256, (12, 17, 3)).astype(np.uint8)


def encoded(image: NDArray[np.generic]) -> bytes:
    return bytes(cv2.imencode(".png", np.asarray(image))[1])


def header(columns: int, rows: int, bits: int = 8, colour: int = 2) -> bytes:
    """A PNG file that only says what it is."""
    content = b"IHDR" + struct.pack(">IIBBBBB", columns, rows, bits, colour, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + struct.pack(">I", 13)
        + content
        + struct.pack(">I", zlib.crc32(content))
    )


def test_colours_and_size() -> None:
    content = encoded(IMAGE[..., ::-1])
    assert np.array_equal(decode_image(content, "x", (12, 17)), IMAGE)
    assert png_size(content, "x") == (12, 17)
    assert np.array_equal(decode_depth(encoded(IMAGE[..., 0]), "x", 0), IMAGE[..., 0])


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "an empty file"),
        (b"<html>404</html>" * 9, "not a PNG file"),
        (header(17, 12)[:20], "damaged"),
        (header(17, 12), "cut short"),
        (header(17, 12, bits=16), "16 bit"),
        (header(17, 12, colour=3), "palette"),
        (header(100_000, 100_000), "no plausible size"),
        (header(0, 12), "no plausible size"),
        (encoded(np.zeros((5, 5, 4), np.uint8)), "RGB with alpha"),
        (encoded(np.zeros((12, 17, 3), np.uint8)), "black all over"),
        (encoded(IMAGE[:, :-1]), "size differs"),
    ],
)
def test_what_is_no_image_of_the_set_is_refused(content: bytes, told: str) -> None:
    with pytest.raises(SourceError, match=told) as caught:
        decode_image(content, "Art/view1.png", (12, 17))
    assert "Art/view1.png" in str(caught.value)


@pytest.mark.parametrize(
    ("image", "told"), [(IMAGE, "in colour"), (np.zeros((5, 5), np.uint8), "tells no depths")]
)
def test_what_is_no_depth_map_is_refused(image: NDArray[np.uint8], told: str) -> None:
    with pytest.raises(SourceError, match=told):
        decode_depth(encoded(image), "Art/disp1.png", 0)


@settings(max_examples=200)
@given(st.data())
def test_no_damage_passes(data: st.DataObject) -> None:
    content = bytearray(encoded(IMAGE))
    place = data.draw(st.integers(0, len(content) - 1))
    if data.draw(st.booleans()):
        content[place] ^= data.draw(st.integers(1, 255))
    else:
        del content[place:]
    with pytest.raises(SourceError):
        decode_image(bytes(content), "x")
