from datetime import UTC, datetime
from pathlib import Path

import pytest

from dfdbench.errors import ResultError
from dfdbench.leaderboard.boards import collect
from dfdbench.leaderboard.submission import submit
from tests.made_results import make_demo_result

WHEN = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


def test_a_methods_name_and_entry_are_one(tmp_path: Path) -> None:
    def named(name: str, entry: str, source: str | None = "a" * 64) -> None:
        result = make_demo_result(lambda pair: 0.1, name)
        method = result.method.model_copy(update={"entry": entry, "source_sha256": source})
        submit(result.model_copy(update={"method": method}), tmp_path, WHEN)

    named("/home/me/mine.py:predict", "mine.py:predict")
    named("another-package's", "theirs:predict", source=None)
    named("constant", "dfdbench.methods.baselines:Constant")
    assert len(collect(tmp_path)) == 3
    named("mymodule:predict", "os:system")
    named("local", "dfdbench.methods.baselines:Constant")
    with pytest.raises(ResultError, match="leads to another entry") as raised:
        collect(tmp_path)
    assert len(raised.value.problems) == 2


def test_a_built_in_method_has_a_source(tmp_path: Path) -> None:
    result = make_demo_result(lambda pair: 0.1, "constant")
    known = {"entry": "dfdbench.methods.baselines:Constant", "source_sha256": None}
    method = result.method.model_copy(update=known)
    submit(result.model_copy(update={"method": method}), tmp_path, WHEN)
    with pytest.raises(ResultError, match="hash of the method's source is lacking"):
        collect(tmp_path)
