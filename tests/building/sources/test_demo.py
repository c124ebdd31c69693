import numpy as np
import pytest

from dfdbench.building.sources.demo import SCENES, DemoScenes, photograph_light
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import SourceError
from dfdbench.methods.baselines import Local
from dfdbench.metrics.scores import nmae


def histogram(store: Dataset, split: str) -> np.ndarray:
    counts = np.zeros(256, np.int64)
    for pair in store.pairs(split):
        depth, valid = store.read_levels(pair)
        counts += np.bincount(depth[valid], minlength=256)
    return counts


def test_every_test_depth_is_covered_by_the_training_depths(demo_store: Dataset) -> None:
    train, test = histogram(demo_store, "train"), histogram(demo_store, "test")
    assert (test <= train).all()


@pytest.mark.slow
def test_low_exposure_is_darker_and_harder(demo_store: Dataset) -> None:
    method = Local()
    brightness, error = [], []
    for exposure in (0, 1, 2):
        pairs = [
            pair
            for pair in demo_store.pairs("test")
            if pair.at == {"view": 1, "illumination": 2, "exposure": exposure}
        ]
        images = [demo_store.read(pair) for pair in pairs]
        brightness.append(np.mean([image.infocus.mean() for image in images]))
        error.append(
            np.mean([nmae(image.levels, method(image.infocus, image.defocus)) for image in images])
        )
    assert brightness == sorted(brightness)
    assert error == sorted(error, reverse=True)
    assert error[0] > 1.3 * error[2]


def test_the_views_see_the_same_scene_shifted_by_the_disparity(demo_store: Dataset) -> None:
    scene = demo_store.to_xarray("Kitchen")
    left, right = (
        scene["images"].sel(view=view, illumination=2, exposure=2).values[0].astype(float)
        for view in (1, 5)
    )
    depth = scene["depth"].sel(view=1).values
    valid = np.isfinite(depth)
    rows, columns = np.nonzero(valid)
    target = np.rint(columns - depth[valid] / 3).astype(int)
    inside = target >= 0
    moved = right[rows[inside], target[inside]]
    still = right[rows[inside], columns[inside]]
    truth = left[rows[inside], columns[inside]]
    assert np.abs(moved - truth).mean() < 0.5 * np.abs(still - truth).mean()


def test_the_camera_saturates_quantises_and_is_seeded() -> None:
    light = np.full((50, 50, 3), 0.5)
    first, again = photograph_light(light, (1, 2)), photograph_light(light, (1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, photograph_light(light, (1, 3)))
    assert photograph_light(np.full((1, 1, 3), 9.0), (1,)).max() == 255
    assert photograph_light(np.zeros((40, 40, 3)), (1,)).max() < 20
    dim = photograph_light(np.full((50, 50, 3), 0.02), (1,)).astype(float)
    assert dim.std() / dim.mean() > 2 * first.std() / first.mean()


def with_axes(**axes: list[int]) -> Manifest:
    manifest = find_manifest("demo")
    return manifest.model_copy(update={"axes": {**manifest.axes, **axes}})


def test_lights_exposures_views_and_scenes_that_there_are_none_of_are_told_at_once() -> None:
    strange = with_axes(view=[1, 3], illumination=[4], exposure=[0, 9])
    scenes = [strange.scenes[0].model_copy(update={"name": "Cellar"})]
    with pytest.raises(SourceError) as caught:
        DemoScenes(strange.model_copy(update={"scenes": scenes}))
    for found in ("view 3", "illumination 4", "exposure 9", "scene Cellar"):
        assert found in str(caught.value)


def test_one_view_and_one_light_make_the_same_images_as_all(demo_store: Dataset) -> None:
    few = DemoScenes(with_axes(view=[5], illumination=[3], exposure=[1])).read("Attic")
    scene = demo_store.to_xarray("Attic")
    at = {"view": 5, "illumination": 3, "exposure": 1}
    assert np.array_equal(few.infocus[0, 0, 0], scene["images"].sel(at).values[0])
    assert np.array_equal(few.depth[0], scene["depth"].sel(view=5).values, equal_nan=True)


def test_training_and_test_share_no_photograph(demo_store: Dataset) -> None:
    manifest = demo_store.manifest

    def photographs(split: str) -> set[str]:
        surfaces = [surface for scene in manifest.scenes_of(split) for surface in SCENES[scene]]
        return {surface.texture.photograph for surface in surfaces}

    assert not photographs("train") & photographs("test")
    assert set(SCENES) == set(manifest.scene_names)
