"""Seeds are written down before anything is run on them."""

from pathlib import Path

import pytest

from dfdbench.board.board import draw_seed, read_draws
from dfdbench.errors import InputError, ResultError
from tests.made_results import edited, make_demo_result


def at_commit(monkeypatch: pytest.MonkeyPatch, commit: str | None) -> None:
    environment = edited(make_demo_result(lambda pair: 0.1).environment, git=commit)
    monkeypatch.setattr("dfdbench.results.environment.describe_environment", lambda: environment)


def test_a_seed_is_drawn_and_written_down(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at_commit(monkeypatch, "abc")
    first, second = draw_seed(tmp_path), draw_seed(tmp_path)
    assert first.seed != second.seed
    assert (first.drawn, first.commit) == (True, "abc")
    assert read_draws(tmp_path) == [second, first]


def test_a_seed_stays_drawn_at_its_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    at_commit(monkeypatch, "abc")
    first = draw_seed(tmp_path)
    named = draw_seed(tmp_path, 7)
    assert not named.drawn
    assert draw_seed(tmp_path, first.seed) == first
    at_commit(monkeypatch, "abd")
    again = draw_seed(tmp_path, str(first.seed))
    assert (again.drawn, again.commit) == (False, "abd")
    assert read_draws(tmp_path) == [again, named]


def test_what_no_commit_holds_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for commit in (None, "abc-dirty"):
        at_commit(monkeypatch, commit)
        with pytest.raises(ResultError, match="in no commit"):
            draw_seed(tmp_path)
    at_commit(monkeypatch, "abc")
    for seed in ("x", -1, "1.5", "007"):
        with pytest.raises(InputError, match="not a seed"):
            draw_seed(tmp_path, seed)
    assert not list(tmp_path.iterdir())
