import json
from pathlib import Path
from typing import Any

import numpy as np

from dfdbench.datasets.dataset import Dataset
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.results.record_file import RESULT
from tests.evaluation.made_methods import method


def test_a_result_says_nothing_of_where_files_lay(tiny_store: Dataset, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("def predict(infocus, defocus):\n    return infocus[..., 0]\n")
    loaded = load_for(tiny_store, f"{file}:predict", {})
    run_method(tiny_store, loaded, "test", tmp_path / "out")
    content = json.loads((tmp_path / "out" / RESULT).read_text())
    assert content["method"]["entry"] == "mine.py:predict"
    assert str(tmp_path) not in json.dumps(content["method"]["entry"])


def test_depth_that_goes_the_wrong_way_is_told(tiny_store: Dataset, tmp_path: Path) -> None:
    depths = {
        images.infocus.tobytes(): images.levels.astype(np.float32)
        for images in map(tiny_store.read, tiny_store.pairs("test"))
    }

    def right(infocus: Any, defocus: Any) -> Any:
        return depths[infocus.tobytes()]

    def turned(infocus: Any, defocus: Any) -> Any:
        return 255 - right(infocus, defocus)

    assert not run_method(tiny_store, method(right), "test", tmp_path / "right").result.warnings
    (told,) = run_method(tiny_store, method(turned), "test", tmp_path / "turned").result.warnings
    assert told == (
        "depth falls where the truth rises on 7 of 7 pairs: tiny-1 wants brighter for nearer"
    )

    def small(infocus: Any, defocus: Any) -> Any:
        return right(infocus, defocus) / 255

    (told,) = run_method(tiny_store, method(small), "test", tmp_path / "small").result.warnings
    assert told.startswith("all levels between 0 and 1; levels go from 0 (far) to 255 (near)")
