from __future__ import annotations

from typing import Any

import pytest

from dfdbench.leaderboard.text_problems import text_problems
from tests.made_results import make_demo_result


def problems(**changes: Any) -> list[str]:
    result = make_demo_result(lambda pair: 0.1)
    method = result.method.model_copy(update=changes)
    return [
        f"{problem.where}: {problem.what}"
        for problem in text_problems(result.model_copy(update={"method": method}), "a.json")
    ]


@pytest.mark.parametrize(
    "changes",
    [
        {"paper": "Größe, 深度, 🐟: “≤ 5 %”", "trained_on": "x" * 1000},
        {"parameters": {"recipe": {"sigmas": [0.3200000000000001] * 256}, "n": -(2**62)}},
    ],
)
def test_what_can_be_seen_and_is_short_is_no_problem(changes: dict[str, Any]) -> None:
    assert problems(**changes) == []


def test_each_place_is_told() -> None:
    found = problems(paper="a\u202eb", parameters={"a": ["\x07"]}, trained_on="x" * 1001)
    assert sorted(found) == [
        "a.json: method.paper: text with characters that cannot be seen",
        "a.json: method.parameters.a: text with characters that cannot be seen",
        "a.json: method.trained_on: a value that is too long to be shown",
    ]


def test_what_is_nested_deep_is_walked_and_keys_are_texts() -> None:
    nested: Any = "\x1b"
    for _ in range(900):
        nested = [nested]
    assert len(problems(parameters={"a": nested})) == 1
    assert len(problems(parameters={"\u200b": 1})) == 1
