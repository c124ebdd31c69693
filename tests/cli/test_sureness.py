"""From end to end: methods that say how sure they are, and methods that leave pixels out."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import dfdbench as dfd
from dfdbench.board.ranking import boards
from dfdbench.datasets.dataset import Dataset
from dfdbench.results.record import load_result
from dfdbench.results.run_folder import read_prediction
from dfdbench.system.parallel import Threads
from tests.board.made_boards import entry_of
from tests.cli.command import Command

BARE = "--no-figures"


def test_a_sigma_is_scored_kept_and_drawn(dfdbench: Command, tiny_store: Dataset) -> None:
    store = str(tiny_store.path)
    ran = dfdbench.fine("run --method mymodule:sure --out run --dataset", store)
    assert sum(line.startswith("score") for line in ran.err.splitlines()) == 1
    said = ran.out.replace("\n", " ")
    assert "in 90 % intervals 0." in said.partition("how sure it is")[2]
    assert Path("run/figures/sureness.png").exists()
    result = load_result("run")
    assert result.protocol_names[-1] == "sure"
    assert result.averages is not None
    assert result.averages["valid"]["nrmse"] is not None, "depth is scored as ever"
    for record in result.pairs:
        pair, shape = record.pair, tiny_store.shape_of(record.scene)
        images = tiny_store.read(pair)
        stated = 5 + np.abs(images.infocus[..., 0].astype(float) - images.defocus[..., 0])
        depth = read_prediction(Path("run"), pair, shape, "depth")
        sigma = read_prediction(Path("run"), pair, shape, "sigma")
        assert depth is not None
        assert sigma is not None
        assert np.array_equal(sigma, stated.astype(np.float32))
        known = images.valid
        held = np.abs(depth - images.truth)[known] <= 1.6448536 * stated[known]
        assert record.score("sure", "within_90") == pytest.approx(held.mean())
        assert (record.score("sure", "density"), record.answered) == (1, 1)
        file = Path("maps", f"{record.id}.npz")
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savez(file, depth=depth, sigma=sigma)
    run = "run --method mymodule:sure --out run --protocol sure --dataset"
    shown = dfdbench.fine(run, store, BARE)
    assert "in 90 % intervals → 0.9" in shown.out
    assert "7 pairs kept" in shown.err
    dfdbench.fine("report run --out page")
    assert "how sure it is" in Path("page/report.html").read_text("utf-8")
    dfdbench.fine("score --predictions maps --out scored --dataset", store)
    for one, other in zip(result.pairs, load_result("scored").pairs, strict=True):
        assert (one.scores, one.prediction_sha256) == (other.scores, other.prediction_sha256)
    compared = dfdbench.fine("compare run scored --protocol sure").out.replace("\n", " ")
    assert "how much farther from 0.9 B is than A" in compared


@pytest.mark.slow
def test_other_processes_say_the_same_sigma(dfdbench: Command, tiny_store: Dataset) -> None:
    run = f"run --method mymodule:sure {BARE} --dataset {tiny_store.path} --out"
    dfdbench.fine(f"{run} one")
    assert "differs" not in dfdbench.fine(f"{run} two --workers 2").err
    one, two = ([pair.scores for pair in load_result(out).pairs] for out in ("one", "two"))
    assert one == two


@pytest.mark.slow
def test_what_leaves_pixels_out_has_no_rank(dfdbench: Command, tiny_store: Dataset) -> None:
    store = str(tiny_store.path)
    entries = []
    for name, lacking in (("gaps", 7), ("sometimes", 4)):
        ran = dfdbench.fine(f"run --method mymodule:{name} --out {name} --dataset", store, BARE)
        pairs = f"{lacking} pairs without an answer for every pixel"
        assert f"score        none: {pairs}" in ran.err
        assert f"note: {pairs}" in ran.out.replace("\n", " ") or pairs in ran.out
        run = dfd.open_run(name, store)
        assert run.result.averages is not None
        assert set(run.result.averages["valid"].values()) == {None}
        density = run.result.averages["sure"]["density"]
        assert density is not None
        assert 0.3 < density < 1
        frame = run.to_frame("valid")
        assert (frame["status"] == "unanswered").sum() == lacking
        assert frame["nrmse"].isna().sum() == lacking
        assert (run.to_frame("sure")["status"] == "ok").all()
        entries.append(entry_of(run.result, Path(name, "result.json")))
    dfdbench.fine("run --method mymodule:predict --out whole --dataset", store, BARE)
    entries.append(entry_of(load_result("whole"), Path("whole/result.json")))
    ranks = {
        board.protocol: {each.entry.label.partition(":")[2]: each.rank for each in board.standings}
        for board in boards(entries)
    }
    for protocol in ("thesis", "valid"):
        assert ranks[protocol] == {"predict": 1, "gaps": None, "sometimes": None}
    assert "predict" not in ranks["sure"]
    # A pair that is answered in full has its own error at any density, and no order of its pixels.
    full = [pair for pair in load_result("sometimes").pairs if pair.answered == 1]
    for pair in full:
        assert pair.score("sure", "nrmse_50") == pair.score("valid", "nrmse")
        assert pair.score("sure", "ause") is None
    dfdbench.fine("report gaps sometimes --out page")
    dfdbench.fine("compare sometimes whole --protocol valid")


def test_a_sigma_of_nought_fails_the_pair_and_who_says_nothing_has_no_such_scores(
    dfdbench: Command, tiny_store: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A process that begins takes seconds, and tests of `check-method` have theirs.
    monkeypatch.setattr("dfdbench.evaluation.check.Processes", Threads)
    store = str(tiny_store.path)
    failed = dfdbench("run --method mymodule:nought --out nought --dataset", store, BARE)
    assert failed.status == 1
    assert "sigma of 0 to 0; expected finite numbers above 0" in " ".join(failed.out.split())
    checked = dfdbench("check-method mymodule:nought")
    assert (checked.status, "sigma of 0 to 0" in " ".join(checked.out.split())) == (1, True)
    assert dfdbench("check-method mymodule:sure").status == 0
    ask = "run --method mymodule:predict --protocol sure --out plain --dataset"
    dfdbench.refused("neither says how sure it is nor leaves pixels", ask, store, BARE)
    content = json.loads(Path("plain/result.json").read_text())
    assert "sure" not in json.dumps(content["protocols"])


def test_predict_keeps_sigma_where_there_is_room(dfdbench: Command, tmp_path: Path) -> None:
    (tmp_path / "in/a").mkdir(parents=True)
    noise = np.random.default_rng(0).integers(0, 256, (40, 50, 3)).astype(np.uint8)
    images = [str(tmp_path / "in/a" / f"{name}.png") for name in ("infocus", "defocus")]
    for image in images:
        cv2.imwrite(image, noise)
    sure = "predict --method mymodule:sure --no-align --out"
    kept = dfdbench.fine(f"{sure} a.npz", *images)
    assert "5, the median pixel's; beside the depth" in kept.err
    with np.load("a.npz") as arrays:
        assert sorted(arrays) == ["depth", "sigma"]
        assert (arrays["sigma"] == 5).all()
    assert "not in a.npy: --out NAME.npz" in dfdbench.fine(f"{sure} a.npy", *images).err
    several = dfdbench.fine(f"{sure} maps", str(tmp_path / "in"))
    assert "beside the depth of 1 map, in .npz files" in several.err
    assert Path("maps/a.npz").exists()
    gaps = "predict --method mymodule:gaps --no-align --out"
    told = dfdbench.fine(f"{gaps} b.npy --figure b.png", *images)
    assert "no answer    in 600 of 2000 pixels" in told.err
    dfdbench.refused("600 of 2000 pixels have no answer", f"{gaps} c.png", *images)
