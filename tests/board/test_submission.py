"""What a submission writes, what it keeps, and what it leaves alone."""

import json
from pathlib import Path
from typing import Any

import pytest

from dfdbench.board.row_file import read_row
from dfdbench.board.submission import submit as submit_only
from dfdbench.errors import ResultError
from dfdbench.methods.registry import built_in_methods
from tests.board.made_boards import add_card, make_tracks, submit
from tests.made_results import edited, limited, make_demo_result, make_result


def labels(path: Path) -> list[str]:
    return [run.label for run in read_row(path).runs]


def test_a_run_is_one_file_with_all_its_protocols(tmp_path: Path) -> None:
    result = make_demo_result(lambda pair: 0.1, protocols=("thesis", "valid"))
    path = submit(result, tmp_path)
    assert path == tmp_path / "results/demo-1-test/mine.json"
    row = read_row(path)
    assert (row.results[0].protocol_names, row.suites) == (("thesis", "valid"), ["clean"])
    assert submit(result, tmp_path) == path
    assert submit(make_demo_result(lambda p: 0.1, parameters={"a": 1}), tmp_path) != path


def test_runs_on_tracks_join_the_row_and_leave_its_other_runs(tmp_path: Path) -> None:
    path = submit(make_demo_result(lambda pair: 0.1, protocols=("thesis", "valid")), tmp_path)
    runs = make_tracks(value=0.2, labels=["noise-1", "gain-2"])
    del runs["clean"]
    assert submit(list(runs.values()), tmp_path) == path
    assert labels(path) == ["clean", "noise-1", "gain-2"]
    assert read_row(path).suites == ["clean", "tracks-1"]
    before = read_row(path).results
    anew = make_tracks(value=0.3, labels=["gain-2"])["gain-2"]
    submit(anew, tmp_path)
    assert read_row(path).results == (*before[:2], anew)


@pytest.mark.parametrize(
    "other",
    [{"source_sha256": "6" * 64}, {"entry": "theirs:predict"}, {"weights_sha256": "7" * 64}],
)
def test_no_method_displaces_another(tmp_path: Path, other: dict[str, Any]) -> None:
    mine = edited(make_demo_result(lambda pair: 0.1), method={"source_sha256": "5" * 64})
    path = submit(mine, tmp_path)
    before = path.read_bytes()
    method = {"source_sha256": "5" * 64, **other}
    theirs = edited(make_demo_result(lambda pair: 0.2), method=method)
    with pytest.raises(ResultError, match=f"another method is there.*{next(iter(other))}"):
        submit(theirs, tmp_path)
    assert path.read_bytes() == before


def test_a_row_is_named_by_its_methods_card(tmp_path: Path) -> None:
    add_card(tmp_path, "wide", "mine", parameters={"window": 9})
    plain = make_demo_result(lambda p: 0.1)
    wide = make_demo_result(lambda p: 0.1, parameters={"window": 9})
    assert submit_only(wide, tmp_path) == tmp_path / "results/demo-1-test/wide.json"
    with pytest.raises(ResultError, match=r"mine has no card.*methods"):
        submit_only(plain, tmp_path)
    told = make_tracks("mine", labels=["gain-1"], uses=["recipe"])
    with pytest.raises(ResultError, match="mine, given the blur, has no card"):
        submit_only(list(told.values()), tmp_path)
    add_card(tmp_path, "told", "mine", given_blur=True)
    assert submit_only(list(told.values()), tmp_path).stem == "told"


def test_a_method_of_ours_may_have_changed_its_source(tmp_path: Path) -> None:
    entry = built_in_methods()["local"]
    method = {"entry": entry, "source_sha256": "5" * 64}
    submit(edited(make_demo_result(lambda p: 0.1, "local"), method=method), tmp_path)
    runs = make_tracks("local", labels=["gain-1"], entry=entry, source_sha256="6" * 64)
    path = submit(runs["gain-1"], tmp_path)
    sources = [result.method.source_sha256 for result in read_row(path).results]
    assert sources == ["5" * 64, "6" * 64]


def test_a_partial_run_does_not_replace_a_complete_one(tmp_path: Path) -> None:
    whole = make_demo_result(lambda pair: 0.1)
    partial = limited(whole, 2)
    path = submit(partial, tmp_path)
    submit(whole, tmp_path)
    before = path.read_bytes()
    with pytest.raises(ResultError, match="2 of 54 pairs"):
        submit(partial, tmp_path)
    assert path.read_bytes() == before


def test_runs_of_several_methods_are_refused(tmp_path: Path) -> None:
    runs = make_tracks(labels=["gain-1"])
    runs["gain-1"] = edited(runs["gain-1"], method={"parameters": {"window": 9}})
    with pytest.raises(ResultError, match=r"not of one method.*gain-1: parameters"):
        submit(list(runs.values()), tmp_path)
    assert not (tmp_path / "results").exists()


def test_a_run_on_other_data_is_refused(tmp_path: Path) -> None:
    (tmp_path / "fingerprints.json").write_text(json.dumps({"demo-1": ["8" * 64]}))
    with pytest.raises(ResultError, match="run on other data than demo-1"):
        submit(make_demo_result(lambda pair: 0.1), tmp_path)
    with pytest.raises(ResultError, match="unknown data set"):
        submit(make_result({("One", 1, 1, 0): 0.1}), tmp_path)
    assert not (tmp_path / "results").exists()
