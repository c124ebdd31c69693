import json
import shutil
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import MethodError, StoreError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.plan import RunOptions, differences_from, plan_run
from dfdbench.evaluation.run import run_method
from dfdbench.methods.method import Method
from dfdbench.results.record import RESULT, load_result
from tests.evaluation.made_methods import Counting, method

FILTERED = """
from pathlib import Path

class Filtered:
    def __init__(self, file, also=()):
        self.level = int(Path(file).read_text())

    def __call__(self, infocus, defocus):
        return infocus[..., 0] * 0 + self.level
"""


def test_a_file_of_a_parameter_counts_by_content(tiny_store: Dataset, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(FILTERED)
    file = tmp_path / "level.txt"
    parameters = {"file": str(file), "also": [{"deep": str(file)}]}
    hashes = []
    for level, reused in ((20, 0), (20, 7), (90, 0)):
        file.write_text(str(level))
        loaded = load_for(tiny_store, f"{tmp_path / 'mine.py'}:Filtered", parameters)
        run = run_method(tiny_store, loaded, "test", tmp_path / "out")
        assert run.reused == reused
        hashes.append(load_result(tmp_path / "out" / RESULT).method.files_sha256)
    assert hashes[0] == hashes[1] != hashes[2]
    assert set(hashes[0]) == {"file", "also.0.deep"}
    assert str(tmp_path) not in json.dumps(run.result.method.parameters)


def test_pairs_are_refused_for_a_method_of_stacks(tiny_store: Dataset) -> None:
    loaded = load_for(tiny_store, "shape-from-focus", {})
    says = "shape-from-focus needs a focal stack, and tiny holds pairs"
    with pytest.raises(MethodError, match=f"{says}.*\nFix: dfdbench build (demo|tiny)@stack-9"):
        plan_run(tiny_store, loaded, "test", RunOptions())


def of_smaller_crop(store: Dataset) -> Dataset:
    """The same images, under a manifest by which `thesis-networks` scores fewer pixels."""
    text = store.manifest.toml.replace("network_crop = 16", "network_crop = 8")
    other = copy(store)
    other.manifest = parse_manifest(text.encode(), "tiny-1.toml")
    return other


def test_what_gives_other_depth_maps_or_scores_is_another_run(tiny_store: Dataset) -> None:
    plan = plan_run(tiny_store, method(Counting()), "test", RunOptions())
    first = plan.identity
    weights = Counting()
    weights.weights_sha256 = "2" * 64  # type: ignore[attr-defined]

    def identity(
        method: Method, split: str = "test", store: Dataset = tiny_store, **options: Any
    ) -> dict[str, Any]:
        return plan_run(store, method, split, RunOptions(**options)).identity

    others = {
        "used": identity(method(Counting(), "1" * 64)),
        "entry": identity(replace(plan.method, entry="tests:Other")),
        "parameters": identity(replace(plan.method, parameters={"window": 9})),
        "weights_sha256": identity(method(weights)),
        "split": identity(plan.method, "One"),
        "manifest_sha256": identity(plan.method, store=of_smaller_crop(tiny_store)),
        "seed": identity(plan.method, seed=1),
        # Depth maps that were not kept cannot be taken over.
        "keep_predictions": identity(plan.method, keep_predictions=False),
    }
    # Each differs in what was changed, and in nothing else.
    for changed, other in others.items():
        assert " ".join(name for name in first if first[name] != other[name]) == changed
    # All that follows from another data set is told by its name.
    before = {**first, "dataset": "other-1", "manifest_sha256": "3" * 64, "protocols": []}
    assert differences_from(before, first, plan.method) == ["data set was other-1 and is tiny-1"]
    del before["dataset"]
    assert len(differences_from(before, first, plan.method)) == 2


def test_the_first_pairs_that_the_store_holds_are_chosen(tiny_store: Dataset) -> None:
    tiny_store.scenes = ("Three",)
    lacking = [p.id for p in tiny_store.manifest.pairs() if p.scene != "Three"]
    tiny_store.attributes["missing_pairs"] = lacking
    plan = plan_run(tiny_store, method(Counting()), "test", RunOptions(limit=2))
    assert [len(plan.expected), len(plan.available)] == [7, 3]
    assert plan.chosen == plan.available[:2]
    with pytest.raises(StoreError, match="no pair of split train") as caught:
        plan_run(tiny_store, method(Counting()), "train", RunOptions())
    assert "with the scenes of that split" in caught.value.problems[0].fix


def test_a_scene_lost_since_then_is_refused(tiny_store: Dataset) -> None:
    # One that no pair of the split is of.
    shutil.rmtree(Path(str(tiny_store.path)) / "One")
    store = Dataset(tiny_store.path)
    with pytest.raises(StoreError, match="has lost scenes") as told:
        plan_run(store, method(Counting()), "test", RunOptions())
    (problem,) = told.value.problems
    assert problem.what.endswith(": One")
    assert problem.fix.startswith("dfdbench build tiny")
    assert str(store.path) in problem.fix
