"""Two runs on the demo set, one of them with a name that would like to be markup."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dfdbench.datasets.dataset import Dataset
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.methods.method import Method
from dfdbench.results.record import RESULT
from dfdbench.results.saved_run import SavedRun, open_saved_run
from tests.once import made_once

HOSTILE = """<img src=x onerror=alert(1)> "q" 'p' | </script> $x$ _ 🐟"""


def half(infocus: NDArray[np.uint8], defocus: NDArray[np.uint8]) -> NDArray[np.float64]:
    return np.linspace(0, 200, infocus.shape[1])[None].repeat(infocus.shape[0], axis=0)


@pytest.fixture(scope="session")
def saved_runs(small_demo: Dataset, tmp_path_factory: pytest.TempPathFactory) -> list[SavedRun]:
    methods = {
        "constant": load_for(small_demo, "constant", {}),
        "hostile": Method(HOSTILE, "m:half", half),
    }

    def run(folder: Path) -> None:
        for name, method in methods.items():
            run_method(small_demo, method, "Kitchen", folder / name)

    folder = made_once(tmp_path_factory, "runs", run)
    return [open_saved_run(folder / name / RESULT, str(small_demo.path)) for name in methods]


@pytest.fixture(scope="session")
def html_page(saved_runs: list[SavedRun], tmp_path_factory: pytest.TempPathFactory) -> Path:
    from dfdbench.report.page import write_html

    def write(folder: Path) -> None:
        write_html(saved_runs, "thesis", folder)

    return made_once(tmp_path_factory, "page", write) / "report.html"
