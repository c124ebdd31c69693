import numpy as np
import pytest

from dfdbench.building.sources.demo import DemoScenes
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import SourceError


def with_axes(**axes: list[int]) -> Manifest:
    manifest = find_manifest("demo")
    return manifest.model_copy(update={"axes": {**manifest.axes, **axes}})


def test_lights_exposures_views_and_scenes_that_there_are_none_of_are_refused() -> None:
    for strange in ({"view": [1, 3]}, {"illumination": [4]}, {"exposure": [0, 9]}):
        with pytest.raises(SourceError, match="other scenes or axes than the demo set's"):
            DemoScenes(with_axes(**strange))
    usual = with_axes(view=[1])
    scenes = [usual.scenes[0].model_copy(update={"name": "Cellar"})]
    with pytest.raises(SourceError, match="other scenes or axes than the demo set's"):
        DemoScenes(usual.model_copy(update={"scenes": scenes}))


def test_one_view_and_one_light_make_the_same_images_as_all(demo_store: Dataset) -> None:
    few = DemoScenes(with_axes(view=[5], illumination=[3], exposure=[1])).read("Attic")
    scene = demo_store.to_xarray("Attic")
    at = {"view": 5, "illumination": 3, "exposure": 1}
    assert np.array_equal(few.infocus[0, 0, 0], scene["images"].sel(at).values[0])
    assert np.array_equal(few.depth[0], scene["depth"].sel(view=5).values, equal_nan=True)
