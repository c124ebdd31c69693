"""What a run comes to, against runs and frames that say the same on other ways."""

from pathlib import Path

import numpy as np
import pytest

import dfdbench as dfd
from dfdbench.board.row_file import leaderboard_folder, read_row
from dfdbench.report.verdict import verdict_facts
from dfdbench.results.saved_run import SavedRun


def lines(run: dfd.Run) -> dict[str, str]:
    return dict(line.split(maxsplit=1) for line in run.verdict().splitlines())


def inverted(infocus: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    return np.asarray(255 - infocus.mean(2))


def test_a_constant_is_run_where_no_row_says_it(tiny_store: dfd.Dataset) -> None:
    found = lines(dfd.run(inverted, tiny_store))
    assert found["score"].endswith("(protocol valid, split test, 7 pairs)")
    constant = dfd.run("constant", tiny_store)
    score = (constant.result.averages or {})["valid"]["nrmse"]
    assert found["constant"].startswith(f"NRMSE {score:.4f}  NMAE ")
    # It is not held against itself.
    assert lines(constant).keys() == {"score", "worst"}
    # Of a training scene, it is the mean of the others.
    alone = dfd.run("constant", tiny_store, "One").result.averages or {}
    found = lines(dfd.run(inverted, tiny_store, "One"))
    assert found["constant"].startswith(f"NRMSE {alone['valid']['nrmse']:.4f}  NMAE ")


def test_a_part_is_held_against_the_same_pairs_of_rows(demo_store: dfd.Dataset) -> None:
    done = dfd.run("local", demo_store, limit=2)
    text = done.verdict()
    found = dict(zip(("score", "constant", "best"), text.splitlines(), strict=False))
    assert "only 2 of 54 pairs" in found["score"]
    ran = {pair.id for pair in done.result.pairs if pair.status == "ok"}
    # What is given the blur, as `local` is, itself left out.
    given = ["graph-cuts", "graph-cuts-rounded", "guided", "sgm", "s-transform"]
    means = {}
    for name in (*given, "constant"):
        row = read_row(leaderboard_folder() / f"results/demo-1-test/{name}.json")
        scores = [p.score("valid", "nrmse") for p in row.results[0].pairs if p.id in ran]
        means[name] = np.mean([score for score in scores if score is not None])
    assert f"NRMSE {means['constant']:.4f}  NMAE " in found["constant"]
    # A row needs no data at hand.
    bare = SavedRun(Path("result.json"), done.result, None, "not here")
    assert verdict_facts(bare, "valid")["constant"]["nrmse"] == pytest.approx(means["constant"])
    best = min(given, key=means.__getitem__)
    assert f"{best}: NRMSE {means[best]:.4f}, given as much (the blur); yours is " in found["best"]


def test_where_no_row_is_given_as_little_the_best_of_all_is_named(demo_store: dfd.Dataset) -> None:
    found = dfd.run(inverted, demo_store, "Market", limit=1).verdict()
    assert ", but it was given the blur, and yours nothing" in found
    assert "worst" not in found


def test_a_mean_that_the_run_lacks_is_not_said(tiny_store: dfd.Dataset) -> None:
    whole = {int(each.infocus.sum()) for each in tiny_store.captures("test")[:3]}

    def some(infocus: np.ndarray, defocus: np.ndarray) -> np.ndarray:
        depth = infocus.mean(2)
        depth[: 0 if int(infocus.sum()) in whole else round(0.8 * len(depth))] = np.nan
        return np.asarray(depth)

    done = dfd.run(some, tiny_store, protocol="sure")
    assert done.verdict_facts()["score"]["nrmse_50"] is None
    assert "surest 50 % –" in lines(done)["score"]
    # Nor is the mean over the pairs that it chose to answer held against others.
    assert list(done.verdict_facts()) == ["score"]
    assert list(dfd.run(some, tiny_store).verdict_facts()) == ["score"]


def test_a_run_that_failed_everywhere_says_so(tiny_store: dfd.Dataset, tmp_path: Path) -> None:
    done = dfd.run(lambda infocus, defocus: 1 / 0, tiny_store, out=tmp_path / "run")
    told = "score        none: only 0 of 7 pairs were evaluated  (protocol valid, split test)"
    assert done.verdict() == told
    assert "7 pairs failed, the first of them" in (tmp_path / "run/tables.md").read_text("utf-8")
