import pytest

from dfdbench.metrics.window import Crop, window_of


@pytest.mark.parametrize(
    ("crop", "rows", "columns"),
    [
        ("whole", (0, 370), (0, 463)),
        ("network", (9, 361), (55, 407)),
        # Cut to 368 x 448 first, so a pixel down and seven across from the one above.
        ("network-of-16", (8, 360), (48, 400)),
    ],
)
def test_each_crop_of_a_middlebury_image(
    crop: Crop, rows: tuple[int, int], columns: tuple[int, int]
) -> None:
    assert window_of(crop, (370, 463), 352) == (slice(*rows), slice(*columns))


def test_an_axis_shorter_than_the_square_is_taken_whole() -> None:
    assert window_of("network", (100, 463), 352) == (slice(0, 100), slice(55, 407))
