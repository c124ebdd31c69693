import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dfdbench.errors import ResultError, UnknownNameError
from dfdbench.evaluate import run_method
from dfdbench.leaderboard import boards, collect
from dfdbench.pair_evaluation import PairEvaluator, load_for
from dfdbench.protocol import RELEASED, find_protocol
from dfdbench.report import run_tables
from dfdbench.result import RESULT, Result, average, load_result, save_result, seal_of
from dfdbench.store import Store
from dfdbench.submission import submit
from dfdbench.verification import load_verification, save_verification, verify


@pytest.fixture
def run(tiny_store: Store, tmp_path: Path) -> Path:
    method = load_for(tiny_store, "local", {"window": 3})
    run_method(tiny_store, method, "test", tmp_path / "run")
    return tmp_path / "run" / RESULT


def test_an_honest_result_gives_the_same_depth_maps(run: Path, tiny_store: Store) -> None:
    found = verify(load_result(run), run, tiny_store, count=3, seed=4)
    assert (len(found.pairs), found.identical, found.largest_difference) == (3, 3, 0)
    assert found.same_source
    again = verify(load_result(run), run, tiny_store, count=3, seed=4)
    assert again.pairs == found.pairs
    assert verify(load_result(run), run, tiny_store, count=99).identical == 7


def test_a_verification_counts_for_its_file_only(run: Path, tiny_store: Store) -> None:
    assert load_verification(run) is None
    save_verification(verify(load_result(run), run, tiny_store), run)
    assert load_verification(run) is not None
    run.write_text(run.read_text() + "\n")
    with pytest.raises(ResultError, match="of another file"):
        load_verification(run)


def lower_scores(content: dict[str, Any]) -> None:
    for pair in content["pairs"]:
        for scores in pair["scores"].values():
            scores["nrmse"] /= 2
            scores["nmae"] /= 2
    for averages in content["averages"].values():
        averages["nrmse"] /= 2
        averages["nmae"] /= 2


def other_hashes(content: dict[str, Any]) -> None:
    lower_scores(content)
    for pair in content["pairs"]:
        pair["prediction_sha256"] = "0" * 64


@pytest.mark.parametrize(
    ("tamper", "told"),
    [
        (lower_scores, "the same depth map has other scores"),
        (other_hashes, "the pair gives another depth map"),
    ],
)
def test_scores_that_were_made_up_are_found_out(
    run: Path, tiny_store: Store, tamper: Callable[[dict[str, Any]], None], told: str
) -> None:
    content = json.loads(run.read_text())
    tamper(content)
    run.write_text(json.dumps(content))
    with pytest.raises(ResultError, match=told):
        verify(load_result(run), run, tiny_store)


def test_a_depth_map_that_differs_within_the_tolerance_passes(run: Path, tiny_store: Store) -> None:
    content = json.loads(run.read_text())
    for pair in content["pairs"]:
        pair["prediction_sha256"] = "0" * 64
    run.write_text(json.dumps(content))
    found = verify(load_result(run), run, tiny_store)
    assert (found.identical, found.largest_difference) == (0, 0)


def test_a_method_whose_name_leads_elsewhere_is_not_run(run: Path, tiny_store: Store) -> None:
    result = load_result(run)
    method = result.method.model_copy(update={"name": "constant"})
    with pytest.raises(ResultError, match="leads to another entry"):
        verify(result.model_copy(update={"method": method}), run, tiny_store)


def test_an_older_protocol_is_verified_under_its_own_window(run: Path, tiny_store: Store) -> None:
    # As a run of before version 2 wrote it; the tiny images are no multiples of 16.
    method = load_for(tiny_store, "local", {"window": 3})
    old = tuple(RELEASED[label] for label in ("thesis", "thesis-networks"))
    evaluate = PairEvaluator(tiny_store, method, 0, old)
    pairs = [evaluate(pair)[0] for pair in tiny_store.pairs("test")]
    labels = [protocol.label for protocol in old]
    result = load_result(run).model_copy(
        update={
            "pairs": pairs, "averages": average(pairs, labels),
            "protocols": [protocol.as_dict() for protocol in old],
        }
    )  # fmt: skip
    save_result(result, run)
    assert verify(load_result(run), run, tiny_store).largest_difference == 0
    with pytest.raises(UnknownNameError, match="another version of protocol"):
        run_tables(load_result(run), find_protocol("thesis-networks").label)
    shown = run_tables(load_result(run), find_protocol("thesis-networks-1").label)
    assert "thesis-networks, version 1: superseded by version 2" in shown[0].title
    unknown = result.model_copy(update={"protocols": [{"name": "mine", "version": 1}]})
    with pytest.raises(UnknownNameError, match="unknown protocol of"):
        verify(unknown, run, tiny_store)


def test_other_data_are_refused(run: Path, tiny_store: Store) -> None:
    result = load_result(run)
    dataset = result.dataset.model_copy(update={"fingerprint": "8" * 64})
    with pytest.raises(ResultError, match="made with other data"):
        verify(result.model_copy(update={"dataset": dataset}), run, tiny_store)


def test_a_verified_result_says_so_on_the_board(demo_store: Store, tmp_path: Path) -> None:
    method = load_for(demo_store, "constant", {})
    result: Result = run_method(
        demo_store, method, "test", tmp_path / "run", keep_predictions=False
    ).result
    path = submit(result, tmp_path)[0]
    save_verification(verify(load_result(path), path, demo_store, count=2), path)
    board = next(b for b in boards(collect(tmp_path)) if b.protocol == "thesis")
    assert board.standings[0].entry.status == "verified"
    content = json.loads(path.read_text())
    content["submission"]["submitted"] = "2020-01-01T00:00:00Z"
    content["submission"]["seal"] = seal_of(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ResultError, match="of another file"):
        collect(tmp_path)
