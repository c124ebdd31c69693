from pathlib import Path

import pytest

from dfdbench.errors import ResultError
from dfdbench.result import save_result
from dfdbench.runs import open_run
from tests.results import make_result


def test_a_folder_of_runs_names_them(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="`dfdbench run` makes one"):
        open_run(tmp_path)
    for name in ("a", "b"):
        save_result(
            make_result({("a", 1, 1, 0): 0.1}), tmp_path / f"demo-1-test/{name}/result.json"
        )
    assert open_run(tmp_path / "demo-1-test/a").label == "mine"
    for folder in (tmp_path, tmp_path / "demo-1-test"):
        with pytest.raises(ResultError, match=r"name the runs: .*demo-1-test/a, .*demo-1-test/b"):
            open_run(folder)
