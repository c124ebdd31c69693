import contextlib
import io
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import ImageOps

from dfdbench.building.sources import image_files
from dfdbench.errors import SourceError

RGB = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.uint8)


def encoded(image: NDArray[Any], kind: str = ".png") -> bytes:
    stored = image[..., ::-1] if image.ndim == 3 else image
    return bytes(cv2.imencode(kind, stored)[1].tobytes())


def test_eight_and_sixteen_bit_are_one_image() -> None:
    deep = RGB.astype(np.uint16) * 257
    for kind in (".png", ".tiff"):
        for image in (RGB, deep):
            read = image_files.read_photograph(encoded(image, kind), "a")
            np.testing.assert_array_equal(read, RGB)
        assert (image_files.read_photograph(encoded(RGB[..., 0], kind), "a") == RGB[..., :1]).all()


def array_file(values: NDArray[Any]) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def test_depth_is_read_from_npy_and_photographs_are_not() -> None:
    depth = np.linspace(0.5, 3, 35, dtype=np.float32).reshape(5, 7)
    content = array_file(depth)
    np.testing.assert_array_equal(image_files.read_depth_file(content, "a.npy"), depth)
    with pytest.raises(SourceError, match="the npy file is damaged"):
        image_files.read_depth_file(content[:-3], "a.npy")
    for values in (np.ones((0, 2)), np.ones((3, 20, 30)), np.ones((2, 2), complex)):
        with pytest.raises(SourceError, match="is not a depth map: numbers of shape") as raised:
            image_files.read_depth_file(array_file(values), "a.npy")
        assert f"{values.dtype} of shape {values.shape}" in str(raised.value)
    with pytest.raises(SourceError, match="the npy file is damaged"):
        image_files.read_depth_file(array_file(np.array([[None]])), "a.npy")
    with pytest.raises(SourceError, match="not an image file"):
        image_files.read_photograph(array_file(RGB), "a.npy")


def test_sixteen_bits_that_are_twelve_are_told() -> None:
    image = (RGB.astype(np.uint16) * 16) + 15
    with pytest.raises(SourceError, match=r"seems to hold 12 bits[^$]*Fix: .*image_bits: 12 for"):
        image_files.read_photograph(encoded(image), "a.png")
    assert image_files.read_photograph(encoded(image), "a.png", bits=12).max() == 255
    assert image_files.read_photograph(encoded(image), "a.png", bits=16).max() == 16
    with pytest.raises(SourceError, match="more than 10 bits"):
        image_files.read_photograph(encoded(image), "a.png", bits=10)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_rotation_is_applied_ignored_or_refused(orientation: int) -> None:
    grey, metres = RGB[..., 0].astype(np.uint16) * 257, RGB[..., 0] / np.float32(3)
    for values, kind in ((RGB, "png"), (RGB, "tiff"), (grey, "tiff"), (metres, "tiff")):
        exif = Pillow.Exif()
        exif[0x0112] = orientation
        file = io.BytesIO()
        Pillow.fromarray(values).save(file, kind, exif=exif)
        content = file.getvalue()
        read = image_files.read_photograph if values is RGB else image_files.read_depth_file
        np.testing.assert_array_equal(read(content, "a", rotation="ignore"), values)
        # Pillow turns a picture as any viewer shows it.
        upright = np.asarray(ImageOps.exif_transpose(Pillow.open(io.BytesIO(content))))
        np.testing.assert_array_equal(read(content, "a", rotation="apply"), upright)
        if orientation > 1:
            with pytest.raises(SourceError, match="is to be turned"):
                read(content, "a")


def test_a_file_cut_short_is_damaged() -> None:
    for kind in (".png", ".jpg", ".tiff"):
        content = encoded(np.kron(RGB, np.ones((40, 40, 1), np.uint8)), kind)
        with pytest.raises(SourceError, match="damaged"):
            image_files.decode_file(content[: len(content) // 2], "a")
    with pytest.raises(SourceError, match="not an image file"):
        image_files.decode_file(b"GIF89a", "a.gif")


def test_transparency_is_refused_unless_there_is_none() -> None:
    opaque = np.dstack([RGB, np.full(RGB.shape[:2], 255, np.uint8)])
    content = bytes(cv2.imencode(".png", opaque[..., [2, 1, 0, 3]])[1].tobytes())
    np.testing.assert_array_equal(image_files.read_photograph(content, "a"), RGB)
    opaque[0, 0, 3] = 10
    with pytest.raises(SourceError, match="transparent"):
        image_files.read_photograph(bytes(cv2.imencode(".png", opaque)[1].tobytes()), "a")


def test_depth_is_read_as_it_stands() -> None:
    metres = np.array([[0.5, np.nan], [2.25, 3.5]], np.float32)
    read = image_files.read_depth_file(encoded(metres, ".tiff"), "d.tiff")
    np.testing.assert_array_equal(read, metres)
    millimetres = np.array([[500, 65535]], np.uint16)
    assert image_files.read_depth_file(encoded(millimetres), "d.png").tolist() == [[500, 65535]]
    with pytest.raises(SourceError, match="in colour"):
        image_files.read_depth_file(encoded(RGB), "d.png")


def test_an_image_of_another_kind_or_size_and_an_empty_depth_map_are_refused() -> None:
    for content, said in (
        (b"", "an empty file"),
        (b"<html>404</html>" * 9, "not a PNG file"),
        (encoded(RGB.astype(np.uint16)), "uint16, 3 channels"),
        (encoded(np.ones((5, 7, 4), np.uint8)), "uint8, 4 channels"),
        (encoded(np.zeros((5, 7, 3), np.uint8)), "black all over"),
        (encoded(RGB[:, :-1]), "size differs"),
    ):
        with pytest.raises(SourceError, match=said) as caught:
            image_files.decode_image(content, "Art/view1.png", (5, 7))
        assert "Art/view1.png" in str(caught.value)
    for image, said in ((RGB, "in colour"), (np.zeros((5, 5), np.uint8), "no depth is known")):
        with pytest.raises(SourceError, match=said):
            image_files.decode_levels(encoded(image), "Art/disp1.png", 0)


@settings(max_examples=200)
@given(st.data())
def test_no_damage_changes_an_image(data: st.DataObject) -> None:
    content = bytearray(encoded(RGB))
    place = data.draw(st.integers(0, len(content) - 1))
    if data.draw(st.booleans()):
        content[place] ^= data.draw(st.integers(1, 255))
    else:
        del content[place:]
    with contextlib.suppress(SourceError):
        assert np.array_equal(image_files.decode_image(bytes(content), "x"), RGB)


def test_a_pfm_file_runs_from_the_bottom_up_in_either_order_of_bytes() -> None:
    rows = np.arange(6, dtype=np.float32).reshape(2, 3)
    for scale, kind in (("-1.0", "<f4"), ("1.0", ">f4")):
        content = f"Pf\n3 2\n{scale}\n".encode() + rows[::-1].astype(kind).tobytes()
        np.testing.assert_array_equal(image_files.read_depth_file(content, "a.pfm"), rows)
        with pytest.raises(SourceError, match="the pfm file is damaged"):
            image_files.read_depth_file(content[:-3], "a.pfm")
    with pytest.raises(SourceError, match="the pfm file is damaged"):
        image_files.read_depth_file(b"Pf\nthree", "a.pfm")


def test_an_npz_file_holds_one_array_or_one_called_depth() -> None:
    held = io.BytesIO()
    np.savez(held, K=np.eye(3), depth=np.ones((2, 3)))
    assert image_files.read_depth_file(held.getvalue(), "a.npz").shape == (2, 3)
    with pytest.raises(SourceError, match="the npz file is damaged"):
        image_files.read_depth_file(held.getvalue()[:-30], "a.npz")
    held = io.BytesIO()
    np.savez(held, near=np.eye(3), far=np.eye(3))
    with pytest.raises(SourceError, match=r"none is called depth.*got near, far$"):
        image_files.read_depth_file(held.getvalue(), "a.npz")
