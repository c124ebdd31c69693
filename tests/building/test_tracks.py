"""Data sets built on tracks, and what reads them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from scipy import ndimage

from dfdbench.api import run
from dfdbench.audit.trained_on import training_side
from dfdbench.blur.formation import focus_levels, form_pair, form_stack
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.tracks import find_degradation
from dfdbench.building.build import build_store
from dfdbench.building.export import export_png
from dfdbench.building.sources import open_source
from dfdbench.datasets.catalog import with_track
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.fingerprint import ATTRIBUTES_SHA256, attributes_digest
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import InputError, MethodError, StoreError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.system.parallel import Threads
from tests.conftest import TINY_TOML


@pytest.fixture(scope="module")
def on_track(tiny_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Dataset]:
    """Build the tiny set on a track, in a place of its own or in one by name."""

    def build(label: str, place: Path | None = None, threads: int = 1) -> Dataset:
        tracked = with_track(parse_manifest(TINY_TOML.encode(), "tiny-1.toml"), label)
        place = place or tmp_path_factory.mktemp("track") / "a.zarr"
        source = open_source(tracked, tiny_set / "site")
        report = build_store(tracked, source, place, pool=Threads(threads))
        assert report.fingerprint == Dataset(place).fingerprint
        return Dataset(place)

    return build


@pytest.fixture(scope="module")
def tracked(on_track: Callable[..., Dataset]) -> Dataset:
    return on_track("camera-1")


@pytest.fixture(scope="module")
def stacks(on_track: Callable[..., Dataset]) -> Dataset:
    return on_track("stack-5")


@pytest.mark.slow
@pytest.mark.parametrize("label", ["camera-2", "shift-1", "occlusion-3"])
def test_a_track_s_store_holds_its_images_and_does_not_tell_how(
    on_track: Callable[..., Dataset], tiny_manifest: Manifest, tiny_store: Dataset, label: str
) -> None:
    store = on_track(label)
    assert store.manifest == with_track(tiny_manifest, label)
    assert store.fingerprint != tiny_store.fingerprint
    assert (store.recipe, store.recipe_name) == (None, f"of track {label}")
    assert store.attributes["recipe"] == {"name": "", "parameters": {}}
    assert (store.attributes["degradation"], store.attributes["track_version"]) == (label, 1)
    assert "published" not in str({k: v for k, v in store.attributes.items() if k != "manifest"})
    for pair in store.pairs("all"):
        plain, found = tiny_store.read(pair), store.read(pair)
        recipe, track = RECIPES["published"], find_degradation(label)
        infocus, defocus = form_pair(plain.infocus, plain.levels, recipe, track, pair.id)
        assert np.array_equal(found.infocus, infocus)
        assert np.array_equal(found.defocus, defocus)
        assert np.array_equal(found.levels, plain.levels)
    assert on_track(label, threads=4).fingerprint == store.fingerprint


def test_one_track_s_store_is_not_replaced_by_another_s(
    on_track: Callable[..., Dataset], tracked: Dataset
) -> None:
    fingerprint = tracked.fingerprint
    for label in ("camera-2", "camera-0"):
        with pytest.raises(StoreError, match="holds another data set"):
            on_track(label, Path(str(tracked.path)))
    assert Dataset(tracked.path).fingerprint == fingerprint


def test_a_track_unknown_here_is_told(tiny_store: Dataset) -> None:
    attributes = zarr.open_group(str(tiny_store.path), mode="r+").attrs
    attributes["degradation"] = "haze-1"
    attributes[ATTRIBUTES_SHA256] = attributes_digest(dict(attributes))
    with pytest.raises(StoreError, match=r"(?s)does not know.*haze-1"):
        Dataset(tiny_store.path)


def test_who_asks_for_the_recipe_is_refused(tracked: Dataset, tmp_path: Path) -> None:
    (tmp_path / "solver.py").write_text(
        "class Solver:\n"
        "    def __init__(self, recipe):\n        self.recipe = recipe\n"
        "    def __call__(self, infocus, defocus):\n        return infocus[..., 0]\n"
    )
    solver = f"{tmp_path / 'solver.py'}:Solver"
    with pytest.raises(MethodError, match="a track does not give it"):
        load_for(tracked, solver, {})
    assert load_for(tracked, solver, {"recipe": "published"}).parameters == {"recipe": "published"}
    # One that can measure the blur is not refused, and not said.
    assert load_for(tracked, "local", {}).uses == ()


def test_results_trainings_and_exports_name_the_track(tracked: Dataset, tmp_path: Path) -> None:
    done = run_method(tracked, load_for(tracked, "constant", {}), "test", tmp_path / "run")
    dataset = done.result.dataset
    assert (dataset.name, dataset.short) == ("tiny-1@camera-1", "tiny@camera-1")
    assert (dataset.degradation, dataset.recipe["name"]) == ("camera-1", "")
    assert done.result.method.trained_on == "tiny-1@camera-1, split train"
    assert done.result.complete
    # Depths are the same on any track.
    for name in ("tiny-1@noise-2", "tiny@noise-2", "tiny"):
        side = training_side(f"{name}, split train", tracked)
        assert side is not None
        assert list(side.scenes) == ["One"]
    export_png(tracked, tmp_path / "png", "One")
    assert (tmp_path / "png/One/Illum1/Exp0/view1_camera-1.png").exists()
    assert not list((tmp_path / "png").rglob("*_lin_*"))


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


def test_without_an_infocus_image(on_track: Callable[..., Dataset]) -> None:
    store = on_track("stack-only-3")
    capture = store.read(store.pairs("test")[0])
    assert capture.stack["focus_depth"].values.tolist() == [0, 128, 255]
    assert "infocus" not in capture.facts.roles
    with pytest.raises(InputError, match="no infocus image"):
        run(lambda infocus, defocus: defocus[..., 0], store)


def test_methods_get_a_stack_or_two_of_its_images(stacks: Dataset) -> None:
    seen: list[Any] = []

    def of_stack(stack: Any) -> Any:
        seen.append(stack)
        return np.full(stack.shape[1:3], 90.0)

    def of_pair(infocus: Any, defocus: Any) -> Any:
        seen.append((infocus, defocus))
        return defocus[..., 0].astype(float)

    images = stacks.read(stacks.pairs("test")[0]).images
    assert run(of_stack, stacks, limit=1).result.pairs[0].status == "ok"
    assert np.array_equal(seen[-1].values, images)
    run(of_pair, stacks, limit=1)
    assert np.array_equal(seen[-1][1], images[1])
    done = run(of_pair, stacks, limit=1, parameters={"images": "2,5"})
    assert np.array_equal(seen[-1], images[[2, 5]])
    assert done.result.method.parameters == {"images": [2, 5]}


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

    _, depth = run(Both, stacks, limit=1).images(stacks.pairs("test")[0].id)
    assert (depth == 6).all()


def test_two_images_that_are_none_are_refused_before_the_run(stacks: Dataset) -> None:
    def of_pair(infocus: Any, defocus: Any) -> Any:
        return infocus[..., 0].astype(float)

    with pytest.raises(Exception, match="two numbers from 0"):
        run(of_pair, stacks, parameters={"images": "2"})
    with pytest.raises(Exception, match="image 9 is not there"):
        run(of_pair, stacks, parameters={"images": "0,9"})
