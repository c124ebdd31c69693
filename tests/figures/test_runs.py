from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.manifest import Scene
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import InputError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import run_method
from dfdbench.figures import runs
from dfdbench.results.record import RESULT
from dfdbench.results.saved_run import SavedRun
from tests.conftest import store_of
from tests.made_results import edited, make_result
from tests.made_stack_folder import STACK_TOML, make_stacks

GEOMETRIES = "flat-far", "oblique-near-left"


@pytest.mark.slow
def test_a_run_is_drawn(demo_store: Dataset, tmp_path: Path) -> None:
    method = load_for(demo_store, "constant", {})
    run = run_method(demo_store, method, "test", tmp_path, RunOptions(limit=4))
    saved = SavedRun(tmp_path / RESULT, run.result, demo_store, "")
    paths = runs.draw_run(saved, "thesis")
    # All images of the demo set are of one size: there are no times to draw by pixels.
    assert [path.name for path in paths] == ["scores.png", "best.png", "worst.png", "depths.png"]
    assert all(np.ptp(np.asarray(cv2.imread(str(path)))) == 255 for path in paths)
    pages = runs.draw_run(saved, "thesis", ["pdf"])
    assert {path.suffix for path in pages} == {".pdf"}
    assert pages[0].read_bytes().startswith(b"%PDF")


def test_times_are_drawn_by_pixels_where_sizes_differ(tiny_store: Dataset) -> None:
    # One's images have 24 x 30 pixels, Two's 24 x 31, Three's 24 x 32.
    places = [(scene, 1, 1, exposure) for scene in ("One", "Two", "Three") for exposure in (0, 1)]
    result = make_result(dict.fromkeys(places, 0.1))
    numbered = enumerate(result.pairs)
    pairs = [edited(pair, seconds=float(n), timed_alone=n < 5) for n, pair in numbered]
    figure = runs.pixel_time_figure(tiny_store, edited(result, pairs=pairs))
    assert figure is not None
    every, means, line = figure.axes[0].get_lines()
    assert np.asarray(every.get_ydata()).tolist() == [0, 1, 2, 3, 4]
    assert np.asarray(means.get_xdata()).tolist() == [720, 744, 768]
    assert np.asarray(means.get_ydata()).tolist() == [0.5, 2.5, 4]
    rate = 10 / (2 * 720 + 2 * 744 + 768)
    assert np.allclose(np.asarray(line.get_ydata()), [720 * rate, 744 * rate, 768 * rate])
    assert runs.pixel_time_figure(tiny_store, edited(result, pairs=pairs[:2])) is None


def test_depths_of_a_set_in_metres_are_told_in_metres(tmp_path: Path) -> None:
    manifest = parse_manifest(STACK_TOML.encode(), "mine-1.toml")
    store = store_of(manifest, make_stacks(tmp_path / "mine"), tmp_path / "one.zarr")
    method = load_for(store, "constant", {})
    run = run_method(store, method, "test", tmp_path / "out", RunOptions(limit=1))
    figure = runs.depth_figure(store, run.result, tmp_path / "out")
    assert figure is not None
    scale, (axis,) = store.manifest.depth.scale, figure.axes
    assert scale is not None
    assert axis.get_xlabel() == "metres"
    ends = [label.get_text() for label in axis.get_xticklabels()]
    assert (ends[0], ends[-1]) == (f"{scale.far:g}", f"{scale.near:g}")


def test_dark_pairs_are_drawn_brighter_and_say_so(small_demo: Dataset, tmp_path: Path) -> None:
    # Exposure 0 is a sixteenth of exposure 2's light.
    method = load_for(small_demo, "constant", {})
    run = run_method(small_demo, method, "test", tmp_path, RunOptions(limit=3))
    pairs = {pair.coordinates["exposure"]: pair for pair in run.result.pairs[:3]}
    saved = SavedRun(tmp_path / RESULT, run.result, small_demo, "")
    for exposure, told in ((0, "times brighter"), (2, "")):
        figure = runs.panel_figure(saved, (pairs[exposure],), "thesis", "best")
        assert figure is not None
        assert told in figure.axes[0].get_xlabel()
        shown = figure.axes[0].get_images()[0].get_array()
        assert shown is not None
        assert np.percentile(np.asarray(shown), 99) > 120


def test_a_figure_for_each_table_with_the_tables_means() -> None:
    scenes = [
        Scene(name=f"k0{4 * texture + place}", source="here", geometry=geometry, texture=texture)
        for texture in (0, 1)
        for place, geometry in enumerate(GEOMETRIES)
    ]
    k00 = {("k00", 1, 1, 0): 0.4, ("k00", 1, 1, 1): 0.2}
    others = {("k01", 1, 1, 0): 0.1, ("k04", 1, 1, 0): 0.6, ("k05", 1, 1, 0): 0.3}
    figures = runs.group_figures({"mine": make_result(k00 | others)}, "thesis", scenes)
    assert list(figures) == ["exposure", "geometry", "texture"]
    axis = figures["geometry"].axes[0]
    assert tuple(label.get_text() for label in axis.get_yticklabels()) == GEOMETRIES
    means = [container[0].get_xdata()[0] for container in axis.containers]
    assert np.allclose(means, [0.4, 0.2])


def test_a_pair_is_drawn_and_with_a_prediction_its_error_too(tiny_store: Dataset) -> None:
    pair = open_dataset(str(tiny_store.path)).captures("test")[0]
    figure = runs.show(pair)
    assert [axis.get_title() for axis in figure.axes[:3]] == ["in-focus", "defocus", "ground truth"]
    # What a notebook asks for.
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    figure = runs.show(pair, pair.depth.astype(np.float32) + 3)
    error = figure.axes[4].images[0].get_array()
    assert error is not None
    assert figure.axes[4].get_title() == "prediction − truth"
    np.testing.assert_array_equal(np.asarray(error)[pair.valid], 3)
    assert np.ma.getmaskarray(error)[~pair.valid].all()


def test_what_is_no_pair_is_told(tiny_store: Dataset) -> None:
    captures = open_dataset(str(tiny_store.path)).captures()
    for wrong, kind in ((None, "NoneType"), (captures, "Captures")):
        with pytest.raises(TypeError, match=f"draws a capture.*, not {kind}"):
            runs.show(wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"shape \(\d+, \d+\), got shape \(3, 4\)"):
        runs.show(captures[0], np.zeros((3, 4)))


def test_a_depth_map_of_photographs_is_bright_where_it_is_near() -> None:
    image, metres = np.zeros((8, 9, 3), np.uint8), np.full((8, 9), 2.0)
    metres[0] = 0.5
    figure = runs.predicted_figure(image, image, metres, "metres", "distance")
    shown, bar = figure.axes[2].images[0], figure.axes[3]
    near, far = shown.to_rgba(np.array([0.5, 2.0]))
    assert near.mean() > far.mean()
    assert (shown.get_clim(), bar.get_ylabel()) == ((0.5, 2), "metres (brighter is nearer)")
