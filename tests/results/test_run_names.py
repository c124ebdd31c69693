from __future__ import annotations

from pathlib import Path

import pytest

from dfdbench.results.record import Result
from dfdbench.results.run_names import told_apart, without_previous
from dfdbench.results.saved_run import SavedRun
from tests.made_results import make_demo_result


def run(path: str, result: Result) -> SavedRun:
    return SavedRun(Path(path), result, None, "")


@pytest.mark.parametrize(
    ("paths", "labels"),
    [
        (["v1/result.json", "v2/result.json"], ["mine (v1)", "mine (v2)"]),
        (["a/x/result.json", "b/x/result.json"], ["mine (a/x)", "mine (b/x)"]),
        (["old.json", "new.json"], ["mine (old)", "mine (new)"]),
    ],
)
def test_runs_of_one_label_are_told_apart_by_their_places(
    paths: list[str], labels: list[str]
) -> None:
    same = make_demo_result(lambda _: 0.1)
    assert [each.label for each in told_apart(run(path, same) for path in paths)] == labels


def test_a_label_that_no_other_has_stays_as_it_is() -> None:
    runs = [
        run("v1/result.json", make_demo_result(lambda _: 0.1)),
        run("v2/result.json", make_demo_result(lambda _: 0.1, parameters={"window": 9})),
        run("v3/result.json", make_demo_result(lambda _: 0.1, fingerprint="5" * 64)),
    ]
    assert told_apart(runs) == runs


def test_a_run_set_aside_is_left_out_beside_the_newer_one_only() -> None:
    x, before, other = Path("r/x"), Path("r/x.previous"), Path("r/y.previous/result.json")
    assert without_previous([x, before, other]) == ([x, other], [(before, x)])
    newer = x / "result.json"
    assert without_previous([before, newer]) == ([newer], [(before, newer)])
    assert without_previous([before]) == ([before], [])
