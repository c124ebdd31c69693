import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dfdbench.errors import ResultError
from dfdbench.leaderboard.tracks_submission import (
    is_tracks_file,
    load_tracks,
    submit_tracks,
    tracks_label,
)
from dfdbench.results.record_file import seal_of
from tests.leaderboard.made_tracks import make_tracks
from tests.made_results import limited


def test_a_submission_is_one_small_file_of_all_tracks(tmp_path: Path) -> None:
    results = make_tracks()
    path = submit_tracks(results, tmp_path)
    assert path == tmp_path / "results/demo-1-test/tracks/mine.json"
    assert is_tracks_file(path)
    # 22 results of 54 pairs; as files of their own some 30 KB each.
    assert path.stat().st_size < 200_000
    assert load_tracks(path, tmp_path).keys() == results.keys()


def test_who_was_told_has_a_file_of_its_own_by_what_the_record_says(tmp_path: Path) -> None:
    submit_tracks(make_tracks("graph-cuts"), tmp_path)
    told = make_tracks("graph-cuts", uses=["recipe"])
    assert tracks_label(told) == "graph-cuts, given the blur"
    assert submit_tracks(told, tmp_path).name == "graph-cuts-told.json"
    # Whoever gives a blur may give the true one.
    given = make_tracks("graph-cuts", parameters={"recipe": "published"})
    assert tracks_label(given) == "graph-cuts (recipe=published), given a blur"
    assert len(list(tmp_path.rglob("*.json"))) == 2


def test_runs_of_several_methods_are_refused(tmp_path: Path) -> None:
    results = make_tracks() | {"gain-1": make_tracks("other")["gain-1"]}
    with pytest.raises(ResultError, match="not of one method") as refused:
        submit_tracks(results, tmp_path)
    assert refused.value.problems[0].where == "this run on gain-1: method"
    assert not list(tmp_path.rglob("*.json"))


def test_fewer_tracks_do_not_take_the_place_of_more(tmp_path: Path) -> None:
    results = make_tracks()
    path = submit_tracks(results, tmp_path)
    before = path.read_bytes()
    partly = results | {"gain-2": limited(results["gain-2"], 3)}
    for fewer in (make_tracks(labels=["gain-1"]), partly):
        with pytest.raises(ResultError, match="do not take the place"):
            submit_tracks(fewer, tmp_path)
    assert path.read_bytes() == before
    submit_tracks(make_tracks(value=0.2), tmp_path)
    assert path.read_bytes() != before


def better(content: dict[str, Any]) -> None:
    content["runs"]["gain-1"]["scores"]["nrmse"][0] /= 2


def untold(content: dict[str, Any]) -> None:
    content["runs"]["gain-1"]["uses"] = ["recipe"]
    content["submission"]["seal"] = seal_of(content)


def worse_than_itself(content: dict[str, Any]) -> None:
    content["runs"]["gain-1"]["scores"]["nmae"][0] = 0.9
    content["submission"]["seal"] = seal_of(content)


def told_recipe(content: dict[str, Any]) -> None:
    content["runs"]["gain-1"]["recipe"] = content["runs"]["clean"]["recipe"]
    content["submission"]["seal"] = seal_of(content)


def other_protocol(content: dict[str, Any]) -> None:
    content["protocol"]["crop"] = "network"
    content["submission"]["seal"] = seal_of(content)


def untimed(content: dict[str, Any]) -> None:
    content["runs"]["gain-1"]["seconds"][0] = None
    content["submission"]["seal"] = seal_of(content)


def unsealed(content: dict[str, Any]) -> None:
    content["submission"] = None


@pytest.mark.parametrize(
    ("tamper", "told"),
    [
        (better, "edited after it was sealed"),
        (untold, "the file's name is not its method's"),
        (worse_than_itself, "NMAE is larger than NRMSE"),
        (told_recipe, "a track tells no blur recipe"),
        (other_protocol, "not a released protocol"),
        (untimed, "what was measured is lacking"),
        (unsealed, "not a submission"),
    ],
)
def test_what_was_tampered_with_is_refused(
    tmp_path: Path, tamper: Callable[[dict[str, Any]], None], told: str
) -> None:
    path = submit_tracks(make_tracks(labels=["gain-1"]), tmp_path)
    content = json.loads(path.read_text("utf-8"))
    tamper(content)
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ResultError, match=told):
        load_tracks(path, tmp_path)


def test_a_file_elsewhere_is_told_where_it_belongs(tmp_path: Path) -> None:
    path = submit_tracks(make_tracks(labels=["gain-1"]), tmp_path)
    other = path.parents[1] / "valid" / path.name
    other.parent.mkdir()
    path.rename(other)
    with pytest.raises(ResultError, match="wrong folder"):
        load_tracks(other, tmp_path)
