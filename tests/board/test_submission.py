"""What a submission writes and leaves alone; what running its pairs again finds out."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dfdbench.board import row_file
from dfdbench.board.row_file import Row, read_row, row_of, row_text
from dfdbench.board.submission import submit as submit_only
from dfdbench.board.submission import verify
from dfdbench.datasets.catalog import with_track
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import DfdbenchError, InputError, ResultError, StoreError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import run_method
from dfdbench.methods.registry import built_in_methods
from dfdbench.results.record import Result
from tests.board.made_boards import add_card, make_tracks, submit
from tests.conftest import store_of
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


def test_no_method_displaces_another(tmp_path: Path) -> None:
    method = {"source_sha256": "5" * 64}
    path = submit(edited(make_demo_result(lambda pair: 0.1), method=method), tmp_path)
    before = path.read_bytes()
    other = {"source_sha256": "6" * 64, "entry": "theirs:predict", "weights_sha256": "7" * 64}
    for name, value in other.items():
        theirs = edited(make_demo_result(lambda pair: 0.2), method={**method, name: value})
        with pytest.raises(ResultError, match=f"another method is there.*{name}"):
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


def test_runs_of_several_methods_or_on_other_data_are_refused(tmp_path: Path) -> None:
    runs = make_tracks(labels=["gain-1"])
    runs["gain-1"] = edited(runs["gain-1"], method={"parameters": {"window": 9}})
    (tmp_path / "fingerprints.json").write_text(json.dumps({"demo-1": ["8" * 64]}))
    for given, told in (
        (list(runs.values()), r"not of one method.*gain-1: parameters"),
        (make_demo_result(lambda pair: 0.1), "run on other data than demo-1"),
        (make_result({("One", 1, 1, 0): 0.1}), "unknown data set"),
    ):
        with pytest.raises(ResultError, match=told):
            submit(given, tmp_path)
    assert not (tmp_path / "results").exists()


HERE = Path("row.json")


@pytest.fixture(scope="module")
def stores(
    tiny_set: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[str, Dataset]]:
    """The tiny set and one of its tracks by name, as if they were released and built here."""
    clean = Dataset(tiny_set / "tiny.zarr")
    place = tmp_path_factory.mktemp("gain") / "gain.zarr"
    on_track = store_of(with_track(clean.manifest, "gain-3"), tiny_set / "site", place)
    found = {"tiny-1": clean, "tiny-1@gain-3": on_track}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dfdbench.board.row_file._manifest_of", lambda _: clean.manifest)
        patch.setattr("dfdbench.board.submission.open_dataset", found.__getitem__)
        yield found
    row_file._pairs_of.cache_clear()


def run_on(
    store: Dataset, folder: Path, entry: str = "local", told: bool = False, **parameters: Any
) -> Result:
    method = load_for(store, entry, parameters, given_blur=told)
    options = RunOptions(keep_predictions=False)
    return run_method(store, method, "test", folder / store.manifest.stem, options).result


@pytest.fixture(scope="module")
def made_row(stores: dict[str, Dataset], tmp_path_factory: pytest.TempPathFactory) -> Row:
    run = run_on(stores["tiny-1"], tmp_path_factory.mktemp("run"), window=3)
    return row_of([run], ["clean"])


@pytest.fixture
def row(made_row: Row) -> Row:
    # A copy: a row keeps the results that it was asked for, and so would what is edited from it.
    return made_row.model_copy()


def tampered(row: Row, scores: float = 1.0, **changes: Any) -> Row:
    (run,) = row.runs
    lower = {
        protocol: {name: [(v or 0) * scores for v in column] for name, column in columns.items()}
        for protocol, columns in run.scores.items()
    }
    return edited(row, runs=[edited(run, scores=lower, **changes)])


def test_an_honest_row_gives_the_same_depth_maps(row: Row, tmp_path: Path) -> None:
    # From its file, as a reviewer has it.
    (tmp_path / "row.json").write_text(row_text(row), "utf-8")
    found = verify(read_row(tmp_path / "row.json"), HERE, count=3, seed=4)
    assert found.passed
    assert found.same_source
    assert [pair.same_map for pair in found.pairs] == [True] * 3
    assert (found.drawn_from, found.seed) == (7, 4)
    again = verify(row, HERE, count=3, seed=4)
    assert [pair.name for pair in again.pairs] == [pair.name for pair in found.pairs]
    assert len(verify(row, HERE, count=99).pairs) == 7


def test_nobody_knows_the_draw_beforehand(row: Row) -> None:
    draws = [verify(row, HERE, count=3) for _ in range(4)]
    assert len({found.seed for found in draws}) == 4
    assert len({tuple(pair.name for pair in found.pairs) for found in draws}) > 1


def test_made_up_scores_and_those_left_out_are_found_out(row: Row) -> None:
    for also, told in (({}, "same"), ({"prediction_sha256": ["0" * 64] * 7}, "another")):
        found = verify(tampered(row, 0.5, **also), HERE, count=2)
        assert not found.passed
        assert f"{told} depth map, scores at most" in str(found.pairs[0])
    (run,) = row.runs
    scores = {**run.scores, "valid": {**run.scores["valid"], "ssim": [None] * 7}}
    found = verify(edited(row, runs=[edited(run, scores=scores)]), HERE, count=2)
    assert [pair.difference for pair in found.pairs] == [float("inf")] * 2


def test_a_depth_map_that_differs_within_the_tolerance_passes(row: Row) -> None:
    found = verify(tampered(row, prediction_sha256=["0" * 64] * 7), HERE)
    assert found.passed
    assert not any(pair.same_map for pair in found.pairs)
    assert not verify(tampered(row, 0.999), HERE, tolerance=0).passed
    for tolerance in (float("inf"), float("nan"), -0.1, 9999.0):
        with pytest.raises(InputError, match="a number from 0 to 1"):
            verify(row, HERE, tolerance=tolerance)


def test_what_cannot_be_run_again_is_refused(row: Row) -> None:
    with pytest.raises(ResultError, match="nothing to verify"):
        verify(tampered(row, status=["failed"] * 7), HERE)
    with pytest.raises(ResultError, match="not what the row was run on"):
        verify(tampered(row, fingerprint="8" * 64), HERE)


def test_what_a_method_was_given_is_as_the_row_says(row: Row) -> None:
    claims: list[dict[str, Any]] = [
        {"uses": []},
        {"trained_on": "demo-1, split train"},
        {"weights_sha256": "0" * 64},
        {"fitted_on": "tiny-1, split train"},
    ]
    for claim in claims:
        found = verify(edited(row, method=claim), HERE, count=1)
        assert not found.passed
        assert f"{next(iter(claim))} is " in str(found.pairs[0])
    (run,) = row.runs
    for told in (
        {"recipe": {**run.recipe, "name": "text"}},
        {"answered": [0.5] * 7},
        {"numbers": {"energy": [3.0] * 7}},
    ):
        found = verify(edited(row, runs=[edited(run, **told)]), HERE, count=1)
        assert not found.passed
        assert f"{next(iter(told))} is " in str(found).replace("energy", "numbers")


def test_code_is_imported_if_trusted(
    row: Row, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("theirs.py").write_text(
        "from pathlib import Path\nPath('imported').touch()\n"
        "from dfdbench.methods.baselines import Local\n"
        "def predict(infocus, defocus, window=3):\n"
        "    return Local(window=window)(infocus, defocus)\n"
    )
    entry = "theirs.py:predict"
    # Its name is one of ours: what counts is what would be imported.
    forged = edited(row, method={"name": "local", "entry": entry, "uses": []})
    for trusted in ((), ("theirs.py",), ("theirs.py:other", "theirs:predict")):
        with pytest.raises(ResultError, match="only if you trust it"):
            verify(forged, HERE, trusted=trusted)
    assert not Path("imported").exists()
    # A file may be called as the package is, and some of our own code loads what it is given.
    Path("dfdbench.theirs.py").write_text(Path("theirs.py").read_text())
    ours = "dfdbench.evaluation.predict:DepthPredictor"
    for claim in (
        {"entry": "dfdbench.theirs.py:predict"},
        {"entry": ours, "parameters": {"method": entry}},
    ):
        with pytest.raises(ResultError, match="only if you trust it"):
            verify(edited(row, method=claim), HERE)
    assert not Path("imported").exists()
    found = verify(forged, HERE, count=2, trusted=[entry])
    assert Path("imported").exists()
    assert [pair.same_map for pair in found.pairs] == [True, True]
    assert (found.passed, found.same_source) == (True, False)


def test_a_fitted_method_is_fitted_anew(stores: dict[str, Dataset], tmp_path: Path) -> None:
    method = load_for(stores["tiny-1"], "positional-prior", {})
    fitted = run_method(stores["tiny-1"], method, "K2", tmp_path / "run").result
    found = verify(row_of([fitted], ["clean"]), HERE, count=99)
    assert found.passed
    assert [pair.same_map for pair in found.pairs] == [True] * 3


@pytest.mark.slow
def test_runs_on_tracks_are_run_as_they_were(stores: dict[str, Dataset], tmp_path: Path) -> None:
    results = [run_on(store, tmp_path, told=True, window=3) for store in stores.values()]
    found = verify(row_of(results, ["tracks-1"]), HERE, count=9, seed=3)
    assert found.passed
    assert found.drawn_from == 14
    assert {pair.name.partition(": ")[0] for pair in found.pairs} == {"clean", "gain-3"}
    # Not given the blur, it is fitted, which random images do not allow, or gives other maps.
    forged = row_of([results[0], edited(results[1], method={"uses": []})], ["tracks-1"])
    try:
        assert not verify(forged, HERE, count=14).passed
    except DfdbenchError as error:
        assert "do not show" in str(error)  # noqa: PT017


def test_all_that_is_not_built_is_named(
    stores: dict[str, Dataset], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = [run_on(store, tmp_path, told=True, window=3) for store in stores.values()]

    def absent(name: str) -> Dataset:
        raise StoreError(f"data set {name} is not built", fix="--dataset demo")

    monkeypatch.setattr("dfdbench.board.submission.open_dataset", absent)
    with pytest.raises(ResultError) as caught:
        verify(row_of(results, ["tracks-1"]), HERE, count=99)
    fixes = [problem.fix for problem in caught.value.problems]
    assert fixes == [f"dfdbench build {name}" for name in stores]
