import json
from pathlib import Path
from typing import Any

import pytest

from dfdbench.datasets.store import Store
from dfdbench.errors import ResultError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.leaderboard.verification import verify_result
from dfdbench.leaderboard.verification_file import load_verification, save_verification
from dfdbench.results.record_file import RESULT, load_result


@pytest.fixture
def run(tiny_store: Store, tmp_path: Path) -> Path:
    method = load_for(tiny_store, "local", {"window": 3})
    run_method(tiny_store, method, "test", tmp_path / "run")
    return tmp_path / "run" / RESULT


def test_a_verification_counts_for_its_file_only(run: Path, tiny_store: Store) -> None:
    result = load_result(run)
    assert load_verification(result, run) is None
    save_verification(verify_result(result, run, tiny_store), 0, run)
    assert load_verification(result, run) is not None
    run.write_text(run.read_text() + "\n")
    with pytest.raises(ResultError, match="of another file"):
        load_verification(result, run)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"tolerance": 1e300}, "tolerance"),
        ({"tolerance": 0.5}, "tolerance"),
        ({"seed": -1}, "seed"),
        ({"seed": 1}, "not those that the seed draws"),
        ({"pairs": ["nonsense"]}, "not those that the seed draws"),
        ({"pairs": []}, "pairs"),
        ({"identical": 99}, "more depth maps are the same"),
        ({"identical": -1}, "identical"),
        ({"largest_difference": 0.01}, "largest_difference"),
        ({"largest_difference": float("nan")}, "largest_difference"),
        ({"reproduced": "yesterday"}, "reproduced"),
        ({"schema_version": 1}, "schema_version"),
        ({"result_sha256": "0" * 64}, "of another file"),
    ],
)
def test_a_verification_of_nonsense_is_refused(
    run: Path, tiny_store: Store, changes: dict[str, Any], told: str
) -> None:
    result = load_result(run)
    place = save_verification(verify_result(result, run, tiny_store, count=2), 0, run)
    place.write_text(json.dumps({**json.loads(place.read_text()), **changes}))
    with pytest.raises(ResultError, match=told):
        load_verification(result, run)
