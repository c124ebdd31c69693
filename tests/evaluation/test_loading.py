from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dfdbench
from dfdbench.datasets.catalog import with_track
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import MethodError, StoreError
from dfdbench.evaluation.loading import images_in, load_for, training_mean
from dfdbench.evaluation.plan import RunOptions, plan_run
from dfdbench.evaluation.run import run_method
from dfdbench.results.wording import knew_blur
from dfdbench.system.parallel import Processes
from tests.conftest import TINY_TOML, store_of


def test_the_training_mean_counts_each_depth_map_once(tiny_store: Dataset) -> None:
    depth = tiny_store.to_xarray("One")["depth"].values
    assert training_mean(tiny_store) == pytest.approx(depth[np.isfinite(depth)].mean())
    assert load_for(tiny_store, "constant", {}).uses == ("training_mean",)


def test_the_training_mean_is_of_no_scene_that_is_tested(tiny_store: Dataset) -> None:
    others = [tiny_store.to_xarray(scene)["depth"].values.ravel() for scene in ("Two", "Three")]
    mean = np.nanmean(np.concatenate(others))
    assert training_mean(tiny_store, "One") == pytest.approx(mean)
    done = dfdbench.run("constant", tiny_store, "One", pool=Processes(2))
    assert done.result.method.trained_on == "tiny-1, all but One"
    for _, depth in done.predictions:
        assert depth == pytest.approx(mean)


def test_a_set_without_a_training_split_says_what_to_do(tiny_folder: Path, tmp_path: Path) -> None:
    text = TINY_TOML.replace('name = "train"', 'name = "learn"')
    store = store_of(text, tiny_folder, tmp_path / "s.zarr")
    with pytest.raises(StoreError, match=r"(?s)no split train.*--param training_mean"):
        load_for(store, "constant", {})
    assert load_for(store, "constant", {"training_mean": 90}).uses == ()


@pytest.mark.parametrize("images", [(0, -1), 0.5, "0,1.5", "1"])
def test_what_names_no_two_images_is_refused(images: Any) -> None:
    assert images_in({"images": "0,4", "window": 9}) == ((0, 4), {"window": 9})
    with pytest.raises(MethodError, match="not two images"):
        images_in({"images": images})


class Asking:
    """Asks for the blur recipe, and has no fit."""

    def __init__(self, recipe: Any) -> None:
        self.recipe = recipe

    def __call__(self, infocus: Any, defocus: Any) -> Any:
        return infocus[..., 0]


class Fitting(Asking):
    """Asks for the blur recipe, and can find it out."""

    def fit(self, pairs: Any) -> None:
        self.recipe = "found"


def test_where_no_recipe_is_told_a_method_with_a_fit_gets_none(
    tiny_store: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = load_for(tiny_store, Fitting, {})
    assert (told.predict.recipe, told.uses) == (tiny_store.recipe, ("recipe",))  # type: ignore[attr-defined]
    monkeypatch.setattr(Dataset, "recipe", None)
    found = load_for(tiny_store, Fitting, {})
    assert (found.predict.recipe, found.uses) == (None, ())  # type: ignore[attr-defined]
    with pytest.raises(MethodError, match=r"asks for a blur recipe[\s\S]*--param recipe="):
        load_for(tiny_store, Asking, {})


@pytest.mark.slow
def test_told_a_method_gets_a_track_s_law_and_says_so(tiny_folder: Path, tmp_path: Path) -> None:
    tracked = with_track(parse_manifest(TINY_TOML.encode(), "tiny-1.toml"), "psf-3")
    store = store_of(tracked, tiny_folder, tmp_path / "psf.zarr")
    told = load_for(store, "local", {}, given_blur=True)
    assert told.learner is None
    assert told.uses == ("recipe",)
    first = run_method(store, told, "test", tmp_path / "run").result
    assert knew_blur(first.method, first.dataset.degradation)
    # Given a blur, by whomever; the same method and data, but not the same run.
    given = load_for(store, "local", {"recipe": "published"})
    assert given.uses == ()
    second = run_method(store, given, "test", tmp_path / "given").result
    assert knew_blur(second.method, second.dataset.degradation)
    untold = plan_run(store, load_for(store, "local", {}), "test", RunOptions())
    assert not untold.identity.get("told")
    among = run_method(store, told, "test", tmp_path / "among", pool=Processes(2)).result
    assert among.pairs[0].prediction_sha256 == first.pairs[0].prediction_sha256


def test_the_law_given_is_of_levels_that_grow_with_distance(
    tiny_folder: Path, tmp_path: Path
) -> None:
    text = TINY_TOML.replace('grows_with = "nearness"', 'grows_with = "distance"')
    manifest = with_track(parse_manifest(text.encode(), "tiny-1.toml"), "psf-3")
    store = store_of(manifest, tiny_folder, tmp_path / "psf.zarr")
    asked: Any = load_for(store, Asking, {}, given_blur=True).predict
    # As in the published images, the near is sharp.
    assert asked.recipe.sigmas[0] < asked.recipe.sigmas[255]


def test_where_there_is_nothing_to_tell_that_is_said(tiny_store: Dataset) -> None:
    assert load_for(tiny_store, "local", {}, given_blur=True).uses == ("recipe",)
    for method, given in (("constant", {}), ("local", {"recipe": "text"})):
        with pytest.raises(MethodError, match="nothing to give"):
            load_for(tiny_store, method, given, given_blur=True)
