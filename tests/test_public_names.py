"""The names that users and results rely on: a change here breaks somebody's code."""

import builtins
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from dfdbench.methods.registry import ENTRY_POINT_GROUP, registered_methods

ROOT = Path(__file__).parents[1]
FACES = {
    "dfdbench": [
        *("Board", "Capture", "Captures", "Comparison", "Dataset", "Run", "Transfer"),
        *("__version__", "build", "compare", "export_onnx", "leaderboard", "list_datasets"),
        *("list_methods", "load_method", "open_dataset"),
        *("open_run", "predict", "run", "run_tracks", "run_transfer", "score", "show", "tune"),
    ],
    "dfdbench.blur": ["RECIPES", "BlurRecipe", "find_recipe", "synthesize"],
    "dfdbench.building": ["SceneError", "SceneImages", "Source", "build_store", "open_source"],
    "dfdbench.metrics": ["nmae", "nrmse", "ssim"],
    "dfdbench.methods": ["Method", "load", "load_method", "registered_methods"],
    "dfdbench.methods.networks": ["DfDNet", "UNet"],
    "dfdbench.torch_pairs": ["TorchPairs"],
}


@pytest.mark.parametrize("face", FACES)
def test_a_face_shows_these_names(face: str) -> None:
    module = importlib.import_module(face)
    assert sorted(module.__all__) == sorted(FACES[face])
    assert all(hasattr(module, name) for name in FACES[face])


def test_all_names_are_there_without_pytorch() -> None:
    code = "import sys; sys.modules['torch'] = None\nfrom dfdbench import *"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("face", ["dfdbench", "dfdbench.methods"])
def test_the_reference_has_every_public_class(face: str) -> None:
    pages = "".join(page.read_text("utf-8") for page in (ROOT / "docs/reference").glob("*.md"))
    for name in FACES[face]:
        found = getattr(importlib.import_module(face), name)
        assert not isinstance(found, type) or f"::: {found.__module__}.{name}\n" in pages


def test_no_public_name_hides_a_builtin() -> None:
    assert not set(FACES["dfdbench"]) & set(dir(builtins)) - {"__version__"}


def test_methods_keep_their_entries_since_results_name_them() -> None:
    assert ENTRY_POINT_GROUP == "dfdbench.methods"
    entries = registered_methods()
    assert {name: entries[name] for name in sorted(entries) if name in BUILT_IN} == BUILT_IN


BUILT_IN = {
    "constant": "dfdbench.methods.baselines:Constant",
    "dfd-net": "dfdbench.methods.learned:DfDNetMethod",
    "favaro-soatto": "dfdbench.methods.favaro_soatto:FavaroSoatto",
    "graph-cuts": "dfdbench.methods.graph_cuts:GraphCuts",
    "graph-cuts-rounded": "dfdbench.methods.rounded_graph_cuts:RoundedGraphCuts",
    "guided": "dfdbench.methods.guided:Guided",
    "local": "dfdbench.methods.baselines:Local",
    "positional-prior": "dfdbench.methods.baselines:PositionalPrior",
    "rational-filters": "dfdbench.methods.rational_filters:RationalFilters",
    "s-transform": "dfdbench.methods.s_transform:STransform",
    "sgm": "dfdbench.methods.sgm:SemiGlobal",
    "u-net": "dfdbench.methods.learned:UNetMethod",
    "wls": "dfdbench.methods.wls:WeightedLeastSquares",
}
