import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.figures.pairs import show


def test_a_pair_is_drawn_and_with_a_prediction_its_error_too(tiny_store: Dataset) -> None:
    pair = open_dataset(str(tiny_store.path)).captures("test")[0]
    titles = [axis.get_title() for axis in show(pair).axes]
    assert titles[:3] == ["in-focus", "defocus", "ground truth"]
    figure = show(pair, pair.depth.astype(np.float32) + 3)
    error = figure.axes[4].images[0].get_array()
    assert error is not None
    assert figure.axes[4].get_title() == "prediction − truth"
    np.testing.assert_array_equal(np.asarray(error)[pair.valid], 3)
    assert np.ma.getmaskarray(error)[~pair.valid].all()


def test_what_is_no_pair_is_told(tiny_store: Dataset) -> None:
    for wrong, kind in (
        (None, "NoneType"),
        (open_dataset(str(tiny_store.path)).captures(), "Captures"),
    ):
        with pytest.raises(TypeError, match=f"draws one capture.* got {kind}"):
            show(wrong)  # type: ignore[arg-type]


def test_a_notebook_shows_the_picture(tiny_store: Dataset) -> None:
    figure = show(open_dataset(str(tiny_store.path)).captures("test")[0])
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
