import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dfdbench.building.build import build_store
from dfdbench.building.sources import open_source
from dfdbench.datasets.store import Store
from dfdbench.datasets.tracked import with_track
from dfdbench.errors import DfdbenchError, InputError, ResultError, UnknownNameError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.pair import PairEvaluator
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import run_method
from dfdbench.leaderboard.boards import boards, collect
from dfdbench.leaderboard.submission import submit
from dfdbench.leaderboard.verification import verify_result, verify_tracks
from dfdbench.leaderboard.verification_file import load_tracks_verification, save_verification
from dfdbench.metrics.protocol import RELEASED, find_protocol
from dfdbench.results.record import Result, average
from dfdbench.results.record_file import RESULT, load_result, save_result, seal_of
from dfdbench.results.run_tables import run_tables
from dfdbench.results.summary import summarise
from dfdbench.results.tracks_record import results_of, tracks_record


@pytest.fixture
def run(tiny_store: Store, tmp_path: Path) -> Path:
    method = load_for(tiny_store, "local", {"window": 3})
    run_method(tiny_store, method, "test", tmp_path / "run")
    return tmp_path / "run" / RESULT


def test_an_honest_result_gives_the_same_depth_maps(run: Path, tiny_store: Store) -> None:
    found = verify_result(load_result(run), run, tiny_store, count=3, seed=4)
    assert (len(found.pairs), found.identical, found.largest_difference) == (3, 3, 0)
    assert found.same_source
    again = verify_result(load_result(run), run, tiny_store, count=3, seed=4)
    assert again.pairs == found.pairs
    assert verify_result(load_result(run), run, tiny_store, count=99).identical == 7


@pytest.mark.parametrize("tolerance", [float("inf"), float("nan"), -0.1, 9999.0])
def test_a_tolerance_that_is_none_is_refused(
    run: Path, tiny_store: Store, tolerance: float
) -> None:
    with pytest.raises(InputError, match="not a tolerance"):
        verify_result(load_result(run), run, tiny_store, tolerance=tolerance)


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
        verify_result(load_result(run), run, tiny_store)


def test_a_depth_map_that_differs_within_the_tolerance_passes(run: Path, tiny_store: Store) -> None:
    content = json.loads(run.read_text())
    for pair in content["pairs"]:
        pair["prediction_sha256"] = "0" * 64
    run.write_text(json.dumps(content))
    found = verify_result(load_result(run), run, tiny_store)
    assert (found.identical, found.largest_difference) == (0, 0)


def test_a_method_whose_name_leads_elsewhere_is_not_run(run: Path, tiny_store: Store) -> None:
    result = load_result(run)
    method = result.method.model_copy(update={"name": "constant"})
    with pytest.raises(ResultError, match="leads to another entry"):
        verify_result(result.model_copy(update={"method": method}), run, tiny_store)


def test_an_older_protocol_is_verified_under_its_own_window(run: Path, tiny_store: Store) -> None:
    # As a run of before version 2 wrote it; the tiny images are no multiples of 16.
    method = load_for(tiny_store, "local", {"window": 3})
    old = tuple(RELEASED[label] for label in ("thesis", "thesis-networks"))
    evaluate = PairEvaluator(tiny_store, method, 0, old)
    pairs = [evaluate(pair)[0] for pair in tiny_store.pairs("test")]
    labels = [protocol.label for protocol in old]
    result = load_result(run).model_copy(
        update={
            "pairs": pairs,
            "averages": average(pairs, labels),
            "protocols": [protocol.as_dict() for protocol in old],
        }
    )
    save_result(result, run)
    assert verify_result(load_result(run), run, tiny_store).largest_difference == 0
    with pytest.raises(UnknownNameError, match="another version of protocol"):
        run_tables(summarise(load_result(run), find_protocol("thesis-networks").label))
    shown = run_tables(summarise(load_result(run), find_protocol("thesis-networks-1").label))
    assert "thesis-networks, version 1: superseded by version 2" in shown[0].title
    unknown = result.model_copy(update={"protocols": [{"name": "mine", "version": 1}]})
    with pytest.raises(UnknownNameError, match="unknown protocol of"):
        verify_result(unknown, run, tiny_store)


def test_other_data_are_refused(run: Path, tiny_store: Store) -> None:
    result = load_result(run)
    dataset = result.dataset.model_copy(update={"fingerprint": "8" * 64})
    with pytest.raises(ResultError, match="made with other data"):
        verify_result(result.model_copy(update={"dataset": dataset}), run, tiny_store)


def claiming(result: Result, name: str, entry: str, **parameters: Any) -> Result:
    """The result as if that method had made it, which is told nothing unless it is one of ours."""
    uses = result.method.uses if entry.startswith("dfdbench.") else []
    update = {"name": name, "entry": entry, "parameters": parameters, "uses": uses}
    return result.model_copy(update={"method": result.method.model_copy(update=update)})


def test_a_result_runs_no_command(run: Path, tiny_store: Store, tmp_path: Path) -> None:
    proof = tmp_path / "ran"
    forged = claiming(
        load_result(run), "subprocess:Popen", "subprocess:Popen", args=f"touch {proof}", shell=True
    )
    for trusted in ((), ("subprocess:Popen",)):
        with pytest.raises(ResultError, match="holds no method"):
            verify_result(forged, run, tiny_store, trusted=trusted)
    assert not proof.exists()


def test_code_of_others_is_imported_only_with_consent(
    run: Path, tiny_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code = (
        "from pathlib import Path\nPath('imported').touch()\n"
        "from dfdbench.methods.baselines import Local\n"
        "def predict(infocus, defocus, window=3):\n"
        "    return Local(window=window)(infocus, defocus)\n"
    )
    Path("theirs.py").write_text(code)
    forged = claiming(load_result(run), "theirs.py:predict", "theirs.py:predict", window=3)
    for trusted in ((), ("theirs.py",), ("theirs.py:other", "theirs:predict")):
        with pytest.raises(ResultError, match="only if you agree"):
            verify_result(forged, run, tiny_store, trusted=trusted)
    assert not Path("imported").exists()
    found = verify_result(forged, run, tiny_store, count=2, trusted=["theirs.py:predict"])
    assert (found.identical, found.same_source) == (2, False)
    # The name holds a folder of the submitter's machine: what was agreed to is run.
    Path("imported").unlink()
    elsewhere = tmp_path / "elsewhere/theirs.py"
    elsewhere.parent.mkdir()
    elsewhere.write_text("raise SystemExit('the wrong file')")
    named = claiming(load_result(run), f"{elsewhere}:predict", "theirs.py:predict")
    verify_result(named, run, tiny_store, count=1, trusted=["theirs.py:predict"])


def test_a_module_beside_the_reviewer_stands_in_for_no_library(
    run: Path, tiny_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [place for place in sys.path if place])
    verify_result(load_result(run), run, tiny_store, count=1)
    assert str(tmp_path) not in sys.path


def test_a_result_chooses_no_file_of_weights(run: Path, tiny_store: Store, tmp_path: Path) -> None:
    entry = "dfdbench.methods.learned:DfDNetMethod"
    forged = claiming(load_result(run), "dfd-net", entry, weights="/etc/passwd")
    with pytest.raises(ResultError, match="must not choose"):
        verify_result(forged, run, tiny_store)
    (tmp_path / "mine.safetensors").write_bytes(b"others")
    with pytest.raises(ResultError, match="other weights"):
        verify_result(forged, run, tiny_store, weights=tmp_path / "mine.safetensors")


def test_a_result_of_pairs_that_there_are_not_is_refused(run: Path, tiny_store: Store) -> None:
    result = load_result(run)
    pairs = [pair.model_copy(update={"scene": "Elsewhere"}) for pair in result.pairs]
    pairs = [pair.model_copy(update={"id": f"Elsewhere/{pair.id}"}) for pair in pairs]
    with pytest.raises(ResultError, match="does not have"):
        verify_result(result.model_copy(update={"pairs": pairs}), run, tiny_store)


def test_a_reproduced_result_says_so_on_the_board(demo_store: Store, tmp_path: Path) -> None:
    method = load_for(demo_store, "constant", {})
    result: Result = run_method(
        demo_store, method, "test", tmp_path / "run", RunOptions(keep_predictions=False)
    ).result
    path = submit(result, tmp_path)[0]
    save_verification(verify_result(load_result(path), path, demo_store, count=2), 0, path)
    board = next(b for b in boards(collect(tmp_path)) if b.protocol == "thesis")
    assert board.standings[0].entry.status == "reproduced"
    content = json.loads(path.read_text())
    content["submission"]["submitted"] = "2020-01-01T00:00:00Z"
    content["submission"]["seal"] = seal_of(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ResultError, match="of another file"):
        collect(tmp_path)


FITTED = """
import numpy as np

class Mean:
    def fit(self, pairs):
        return {"level": np.mean([pair.depth.mean() for pair in pairs])}

    def restore(self, learned):
        self.level = learned["level"]

    def __call__(self, infocus, defocus):
        return np.full(infocus.shape[:2], self.level)
"""


def test_a_fitted_method_is_fitted_anew(
    tiny_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("fitted_mean.py").write_text(FITTED)
    method = load_for(tiny_store, "fitted_mean.py:Mean", {})
    run_method(tiny_store, method, "K2", tmp_path / "run")
    path = tmp_path / "run" / RESULT
    entry = "fitted_mean.py:Mean"
    found = verify_result(load_result(path), path, tiny_store, count=99, trusted=[entry])
    assert found.identical == len(found.pairs) == 3


@pytest.fixture
def tracked(tiny_folder: Path, tiny_store: Store, tmp_path: Path) -> dict[str, Store]:
    """The tiny set and one of its tracks, by name."""
    manifest = with_track(tiny_store.manifest, "gain-3")
    build_store(manifest, open_source(manifest, tiny_folder), tmp_path / "gain.zarr")
    return {"tiny-1": tiny_store, "tiny-1@gain-3": Store(tmp_path / "gain.zarr")}


def runs_on(stores: dict[str, Store], folder: Path, told: bool) -> dict[str, Result]:
    found = {}
    for label, store in zip(("clean", "gain-3"), stores.values(), strict=True):
        method = load_for(store, "local", {"window": 3}, told=told)
        found[label] = run_method(store, method, "test", folder / label).result
    return results_of(tracks_record(found, "valid"))


def test_runs_on_tracks_are_run_again_as_they_were(
    tracked: dict[str, Store], tmp_path: Path
) -> None:
    results = runs_on(tracked, tmp_path, told=True)
    path = tmp_path / "tracks.json"
    path.write_text("{}")
    found = verify_tracks(results, path, tracked.__getitem__, count=9, seed=3)
    assert (len(found.pairs), found.identical) == (9, 9)
    assert {name.partition(": ")[0] for name in found.pairs} == {"clean", "gain-3"}
    # Scores are kept to six digits.
    assert found.largest_difference <= 5e-7
    save_verification(found, 3, path)
    assert load_tracks_verification(results, path) is not None
    with pytest.raises(ResultError, match="not those that the seed draws"):
        load_tracks_verification({"gain-3": results["gain-3"]}, path)


@pytest.mark.slow
def test_who_was_told_and_does_not_say_so_is_found_out(
    tracked: dict[str, Store], tmp_path: Path
) -> None:
    results = runs_on(tracked, tmp_path, told=True)
    method = results["gain-3"].method.model_copy(update={"uses": []})
    results["gain-3"] = results["gain-3"].model_copy(update={"method": method})
    # Not told, it is fitted, which random images do not allow, or gives other depth maps.
    with pytest.raises(DfdbenchError, match=r"another depth map|do not show"):
        verify_tracks(results, tmp_path / "x.json", tracked.__getitem__, count=14)


def test_runs_on_other_data_are_not_verified(tracked: dict[str, Store], tmp_path: Path) -> None:
    results = runs_on(tracked, tmp_path, told=True)
    with pytest.raises(ResultError, match="made with other data"):
        verify_tracks(results, tmp_path / "x.json", lambda _: tracked["tiny-1"], count=14)


@pytest.mark.parametrize(
    "claim",
    [
        {"uses": []},
        {"uses": ["recipe", "training_mean"]},
        {"trained_on": "demo-1, split train"},
        {"weights_sha256": "0" * 64},
        {"fitted_on": "tiny-1, split train"},
    ],
)
def test_what_a_method_was_told_is_as_the_result_says(
    run: Path, tiny_store: Store, claim: dict[str, Any]
) -> None:
    result = load_result(run)
    assert result.method.uses == ["recipe"]
    forged = result.model_copy(update={"method": result.method.model_copy(update=claim)})
    with pytest.raises(ResultError, match="other than the result says") as raised:
        verify_result(forged, run, tiny_store, count=1)
    assert f"method.{next(iter(claim))}" in str(raised.value)
