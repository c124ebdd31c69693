from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError
from dfdbench.training.search.log import Row, SearchFolder
from dfdbench.training.search.particle import COMPONENTS
from dfdbench.training.search.plan import SearchPlan
from tests.training.search.made_searches import small_plan, some_rows


def opened(plan: SearchPlan, path: Path) -> SearchFolder:
    folder = SearchFolder(path)
    folder.open(plan.identity)
    return folder


@pytest.fixture
def plan(tiny_store: Dataset) -> SearchPlan:
    return small_plan(tiny_store, particles=3)


@pytest.fixture
def path(plan: SearchPlan, tmp_path: Path) -> Path:
    folder = opened(plan, tmp_path / "s")
    for row in some_rows(plan):
        folder.note(row)
    return tmp_path / "s"


def test_what_is_noted_is_read_again_bit_for_bit(plan: SearchPlan, path: Path) -> None:
    again = opened(plan, path)
    assert len(again) == 3
    for row in some_rows(plan):
        found = again[row.place]
        assert found is not None
        assert np.array_equal(found.position, row.position)
        again.require_same(row.place, row.position)
    failed = again[0, 2]
    assert failed is not None
    assert (failed.outcome.value, failed.outcome.failed) == (np.inf, "diverged: at step 3")
    whole = again[0, 0]
    assert isinstance(whole, Row)
    assert whole.outcome == some_rows(plan)[0].outcome
    assert again[1, 0] is None


def test_a_line_that_a_kill_cut_short_is_left_out(plan: SearchPlan, path: Path) -> None:
    log = path / "positions.csv"
    text = log.read_text()
    for cut in (1, 5, len(text.splitlines()[-1])):
        log.write_text(text[:-cut])
        assert len(opened(plan, path)) == 2
        assert log.read_text() == "".join(text.splitlines(keepends=True)[:-1])
    log.write_text(text[: len(text) // 8])
    assert len(opened(plan, path)) == 0


def changed(line: int, column: str, value: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        rows = [row.split(",") for row in text.splitlines()]
        rows[line - 1][rows[0].index(column)] = value
        return "\n".join(",".join(row) for row in rows) + "\n"

    return change


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (changed(2, "objective", "nan"), "objective: no number"),
        (changed(2, "particle", "first"), "line 2"),
        (lambda text: text.replace("\n0,1,", "\n0,1,,", 1), "line 3"),
        (lambda text: text.replace("width_8", "width"), "width_8"),
        (lambda text: text + text.splitlines()[1] + "\n", "twice"),
    ],
)
def test_a_log_that_cannot_be_is_named_and_kept(
    plan: SearchPlan, path: Path, change: Callable[[str], str], told: str
) -> None:
    log = path / "positions.csv"
    log.write_text(change(log.read_text()))
    before = log.read_text()
    with pytest.raises(InputError, match=told):
        opened(plan, path)
    assert log.read_text() == before


def test_every_bad_row_is_named(plan: SearchPlan, path: Path) -> None:
    log = path / "positions.csv"
    for line in (2, 4):
        log.write_text(changed(line, "width_8", "wide")(log.read_text()))
    with pytest.raises(InputError) as caught:
        opened(plan, path)
    assert len(caught.value.problems) == 2


def test_a_position_that_the_search_does_not_come_to_is_named(plan: SearchPlan, path: Path) -> None:
    folder = opened(plan, path)
    other = some_rows(plan)[0].position.copy()
    other[COMPONENTS.index("width_20")] += 1
    with pytest.raises(InputError, match=r"width_20 is .* iteration 0, particle 0"):
        folder.require_same((0, 0), other)
    folder.require_same((5, 0), other)


def test_another_search_is_refused_with_what_differs(
    plan: SearchPlan, path: Path, tiny_store: Dataset
) -> None:
    before = {file.name: file.read_bytes() for file in path.iterdir()}
    others = small_plan(tiny_store, {"noise": 1.0}, particles=3, gamma=0.5)
    with pytest.raises(InputError) as caught:
        opened(others, path)
    named = [problem.what.partition("with ")[2] for problem in caught.value.problems]
    assert named == ["gamma 0.3 instead of 0.5", "configuration.noise 0.0 instead of 1.0"]
    assert {file.name: file.read_bytes() for file in path.iterdir()} == before
    (path / "search.json").write_text("{")
    with pytest.raises(InputError, match="cannot be read"):
        opened(plan, path)


def test_a_folder_with_something_else_is_refused(plan: SearchPlan, tmp_path: Path) -> None:
    (tmp_path / "precious.txt").write_text("keep")
    with pytest.raises(InputError, match="something else than a search"):
        opened(plan, tmp_path)
    assert [file.name for file in tmp_path.iterdir() if file.is_file()] == ["precious.txt"]


def test_trainings_are_forgotten_by_their_place(plan: SearchPlan, tmp_path: Path) -> None:
    folder = opened(plan, tmp_path / "s")
    for place in ((0, 0), (0, 1)):
        folder.training(place).mkdir(parents=True)
    folder.forget([(0, 1), (7, 7)])
    assert [item.name for item in (tmp_path / "s/particles").iterdir()] == ["000-000"]


def test_a_log_that_is_no_text_is_refused(plan: SearchPlan, path: Path) -> None:
    (path / "positions.csv").write_bytes(bytes(range(128, 256)))
    with pytest.raises(InputError, match="the log is no text"):
        opened(plan, path)
