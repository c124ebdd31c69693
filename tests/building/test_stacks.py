"""Focal stacks of a synthetic set: built, run by methods of stacks and of pairs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from dfdbench.blur.formation import focus_levels, form_stack
from dfdbench.blur.recipe import RECIPES
from dfdbench.building.build import build_store
from dfdbench.building.sources import open_source
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.tracked import with_track
from dfdbench.errors import InputError
from dfdbench.evaluation.evaluate import evaluate


@pytest.fixture
def stacks(tiny_manifest: Manifest, tiny_folder: Path, tmp_path: Path) -> Dataset:
    manifest = with_track(tiny_manifest, "stack-5")
    build_store(manifest, open_source(manifest, tiny_folder), tmp_path / "stacks.zarr")
    return Dataset(tmp_path / "stacks.zarr")


def test_a_flat_scene_is_blurred_by_its_distance_from_each_plane() -> None:
    image = np.random.default_rng(0).integers(0, 256, (60, 70, 3)).astype(np.uint8)
    stack = form_stack(image, np.full((60, 70), 128, np.uint8), RECIPES["published"], 5)
    for level, made in zip(focus_levels(5), stack, strict=True):
        sigma = 0.32 + abs(level - 128) * 0.01125
        blurred = ndimage.gaussian_filter(image.astype(float), (sigma, sigma, 0), truncate=5)
        # The kernels' faint tails are cut, and images are rounded.
        assert np.abs(made - blurred)[12:-12, 12:-12].max() < 1.5


def test_a_built_stack_says_where_it_is_focused(stacks: Dataset, tiny_store: Dataset) -> None:
    pair = stacks.pairs("test")[0]
    capture, plain = stacks.read(pair), tiny_store.read(pair)
    assert capture.stack["role"].values.tolist() == ["infocus", *["defocus"] * 5]
    assert capture.stack["focus_depth"].values[1:].tolist() == list(focus_levels(5))
    assert np.isnan(capture.stack["focus_depth"].values[0])
    assert np.array_equal(capture.infocus, plain.infocus)
    assert np.array_equal(capture.depth, plain.depth, equal_nan=True)
    assert not stacks.recipe


def test_without_an_infocus_image(
    tiny_manifest: Manifest, tiny_folder: Path, tmp_path: Path
) -> None:
    manifest = with_track(tiny_manifest, "stack-only-3")
    build_store(manifest, open_source(manifest, tiny_folder), tmp_path / "only.zarr")
    store = Dataset(tmp_path / "only.zarr")
    capture = store.read(store.pairs("test")[0])
    assert capture.stack["focus_depth"].values.tolist() == [0, 128, 255]
    assert "infocus" not in capture.facts.roles
    with pytest.raises(InputError, match="no infocus image.*images=0,4"):
        evaluate(lambda infocus, defocus: defocus[..., 0], store)


def test_methods_get_a_stack_or_two_of_its_images(stacks: Dataset) -> None:
    seen: list[Any] = []

    def of_stack(stack: Any) -> Any:
        seen.append(stack)
        return np.full(stack.shape[1:3], 90.0)

    def of_pair(infocus: Any, defocus: Any) -> Any:
        seen.append((infocus, defocus))
        return defocus[..., 0].astype(float)

    pair = stacks.pairs("test")[0]
    images = stacks.read(pair).images
    assert evaluate(of_stack, stacks, limit=1).result.pairs[0].status == "ok"
    assert np.array_equal(seen[-1].values, images)
    evaluate(of_pair, stacks, limit=1)
    assert np.array_equal(seen[-1][1], images[1])
    run = evaluate(of_pair, stacks, limit=1, parameters={"images": "2,5"})
    assert np.array_equal(seen[-1], images[[2, 5]])
    assert run.result.method.parameters == {"images": [2, 5]}


def test_a_method_of_both_gets_the_whole_stack_and_a_fit_too(stacks: Dataset) -> None:
    class Both:
        def fit(self, captures: Any) -> Any:
            return {"images": captures[0].stack.sizes["image"]}

        def restore(self, learned: Any) -> None:
            self.learned = learned

        def __call__(self, infocus: Any, defocus: Any) -> Any:
            return np.zeros(infocus.shape[:2])

        def from_stack(self, stack: Any) -> Any:
            return np.full(stack.shape[1:3], float(self.learned["images"]))

    run = evaluate(Both, stacks, limit=1)
    _, depth = run.images(run.result.pairs[0]) or (None, None)
    assert depth is not None
    assert (depth == 6).all()


def test_two_images_that_are_none_are_refused_before_the_run(stacks: Dataset) -> None:
    def of_pair(infocus: Any, defocus: Any) -> Any:
        return infocus[..., 0].astype(float)

    with pytest.raises(Exception, match="two numbers from 0"):
        evaluate(of_pair, stacks, parameters={"images": "2"})
    with pytest.raises(Exception, match="image 9 is not there"):
        evaluate(of_pair, stacks, parameters={"images": "0,9"})
