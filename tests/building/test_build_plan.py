from pathlib import Path

import pytest
from upath import UPath

from dfdbench.building.build import build_store
from dfdbench.building.build_plan import plan_build, refuse_another_set
from dfdbench.building.sources import open_source
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.store_place import default_store
from dfdbench.errors import InputError, UnknownNameError

DEMO, CAPTURED = find_manifest("demo"), find_manifest("realworld")


def test_a_build_lies_in_the_cache_unless_a_place_is_given(tmp_path: Path) -> None:
    plan = plan_build(DEMO, cache=tmp_path)
    assert Path(plan.place.path) == tmp_path / "stores/demo-1.zarr"
    assert (plan.recipe, plan.steps) == (None, None)
    there = plan_build(DEMO, "memory://mine.zarr", "text")
    assert there.place.protocol == "memory"
    assert there.recipe == "text"


@pytest.mark.parametrize("named", [False, True])
def test_another_blur_or_other_steps_are_refused_in_the_sets_own_place(
    tmp_path: Path, named: bool
) -> None:
    places = [default_store(manifest, tmp_path) if named else None for manifest in (DEMO, CAPTURED)]
    with pytest.raises(InputError, match="another blur recipe"):
        plan_build(DEMO, places[0], "text", cache=tmp_path)
    with pytest.raises(InputError, match="other voltage steps"):
        plan_build(CAPTURED, places[1], steps=(1, 2), cache=tmp_path)
    capture = CAPTURED.capture
    assert capture is not None
    usual = (capture.infocus_step, capture.defocus_step)
    assert plan_build(CAPTURED, places[1], steps=usual, cache=tmp_path).steps == usual
    assert plan_build(DEMO, places[0], "published", cache=tmp_path).recipe is not None


def test_a_link_to_the_sets_own_place_is_that_place(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "cache")
    with pytest.raises(InputError, match="another blur recipe"):
        plan_build(DEMO, default_store(DEMO, tmp_path / "link"), "text", cache=tmp_path / "cache")
    other = UPath(tmp_path / "cache/stores/demo-2.zarr")
    refuse_another_set(DEMO, other, "text", None, tmp_path / "cache")


def test_an_unknown_recipe_is_told() -> None:
    with pytest.raises(UnknownNameError, match="did you mean text"):
        plan_build(DEMO, "my.zarr", "txt")


def test_python_callers_keep_to_it_too(
    tiny_manifest: Manifest, tiny_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path))
    source = open_source(tiny_manifest, tiny_folder)
    place = default_store(tiny_manifest)
    with pytest.raises(InputError, match="name its place"):
        build_store(tiny_manifest, source, place, "text")
    assert not place.parent.exists()
