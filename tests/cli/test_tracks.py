"""The verb that runs a method over tracks, as a user types it."""

import json
from pathlib import Path

import pytest

from tests.cli.command import Command


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--dataset", "demo@noise-1"), "--track NAME chooses"),
        (("--dataset", "realworld"), "captured"),
        (("--track", "nois"), "did you mean noise"),
        (("--split", "tset"), "did you mean test"),
        (("--submit",), "no leaderboard here"),
        (("--method", "constnt"), "did you mean constant"),
        (("--dataset", "middlebury-default"), "dfdbench build"),
    ],
)
def test_what_has_no_tracks_is_told_before_anything_is_built(
    dfdbench: Command,
    words: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path / "cache"))
    refused = dfdbench("tracks", "--method", "constant", *words)
    assert refused.status == 2
    assert said in refused.err
    assert not (tmp_path / "cache").exists()


@pytest.mark.slow
def test_a_method_is_run_on_clean_images_and_on_each_severity(
    dfdbench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path / "cache"))
    words = ("tracks", "--method", "constant", "--split", "Market", "--track", "gain")
    first = dfdbench(*words, "--format", "json")
    assert first.status == 0, first.err
    (row,) = json.loads(first.out)[0]["rows"]
    # A constant looks at no image: no track can change its score.
    assert row["nrmse clean"] == row["nrmse 1"] == row["nrmse 3"] > 0
    folder = Path("results/demo-1-tracks-Market/constant")
    assert (folder / "tracks.png").stat().st_size > 10_000
    labels = ["clean", "gain-1", "gain-2", "gain-3"]
    assert sorted(path.parent.name for path in folder.glob("*/result.json")) == labels
    told = [line.split() for line in first.err.splitlines()]
    assert [words[0] for words in told if words[1:2] == ["NRMSE"]] == labels
    written = {label: (folder / label / "pairs.jsonl").read_bytes() for label in labels}
    assert dfdbench(*words).status == 0
    assert {label: (folder / label / "pairs.jsonl").read_bytes() for label in labels} == written


@pytest.mark.slow
def test_told_runs_are_submitted_without_a_rank_and_verified(
    dfdbench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path / "cache"))
    Path("leaderboard/results").mkdir(parents=True)
    words = ("tracks", "--method", "local", "--split", "Market", "--track", "shift")
    done = dfdbench(*words, "--told", "--submit")
    assert done.status == 0, done.err
    assert "on tracks: blur told" in done.out
    file = Path("leaderboard/results/demo-1-Market/local-given_the_blur.json")
    assert dfdbench("leaderboard", "--check").status == 2
    listed = dfdbench("leaderboard", "--format", "json")
    (row,) = json.loads(listed.out)[0]["rows"]
    assert (row["rank"], row["given_blur"]) == (None, True)
    checked = dfdbench("leaderboard", "verify", "--pairs", "2", str(file))
    assert checked.status == 0, checked.err
    assert checked.out.count("same depth map") == 2
    assert dfdbench("leaderboard").status == dfdbench("leaderboard", "--check").status == 0
