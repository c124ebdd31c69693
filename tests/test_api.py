"""The public functions on a tiny data set: what each returns, shows and refuses."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import dfdbench
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import DfdbenchError, InputError, MethodError, ResultError, UnknownNameError
from tests.conftest import TINY_TOML


def grey(infocus: NDArray[Any], defocus: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(defocus.mean(axis=2))


@pytest.fixture(scope="module")
def done(tiny_set: Path, tmp_path_factory: pytest.TempPathFactory) -> dfdbench.Run:
    store = Dataset(tiny_set / "tiny.zarr")
    return dfdbench.run(grey, store, out=tmp_path_factory.mktemp("done") / "grey")


def test_a_run_has_every_score_in_one_frame(done: dfdbench.Run, tiny_store: Dataset) -> None:
    scores = done.scores
    result = done.results["clean"]
    row = scores.query("protocol == 'thesis' and metric == 'nrmse'").set_index("capture")["value"]
    for pair in result.pairs:
        assert row[pair.id] == pair.scores["thesis"]["nrmse"]
    assert set(scores["protocol"]) == set(result.protocol_names)
    assert done.table("thesis-networks").equals(done.table("thesis-networks-2"))
    last = done.table("thesis").iloc[-1]
    means = row.mean(), done.to_frame("thesis")["nrmse"].mean(), last["nrmse"]
    assert means == pytest.approx([result.averages["thesis"]["nrmse"]] * 3)  # type: ignore[index]
    assert (last.name, *done.table().index.names) == (("all", "all"), "exposure", "illumination")
    part = dfdbench.run("constant", tiny_store.path, limit=1).table()
    assert part.isna().all(axis=None)  # of no group has every pair been run
    regions = done.regions
    assert list(regions) == ["edges", "flat", "far", "near"]
    assert regions.loc[result.pairs[0].id, "far"] == result.pairs[0].regions["far"]
    labels = ("clean", "gain-1", "gain-2", "gain-3", "noise-1")
    assert repr(dfdbench.Run(dict.fromkeys(labels, done._first))).endswith(", and on 2 tracks>")


def test_a_run_keeps_depth_maps_and_reports_them(done: dfdbench.Run, tmp_path: Path) -> None:
    predictions = dict(done.predictions)
    assert len(predictions) == 7
    name, depth = next(iter(predictions.items()))
    images, again = done.images(name)
    assert done.images(images)[0].pair == done.images(images.pair)[0].pair == images.pair
    assert np.array_equal(depth, again)
    assert np.allclose(depth, grey(images.infocus, images.defocus))
    assert "NRMSE by region" in done.report(tmp_path / "page").read_text()


def test_a_run_is_drawn_in_the_forms_asked_for(done: dfdbench.Run) -> None:
    assert {path.suffix for path in done.draw("pdf")} == {".pdf"}
    with pytest.raises(UnknownNameError, match="did you mean svg"):
        done.draw(["png", "svgz"])
    assert not list(done.folder.rglob("*.png"))


def test_a_run_that_says_no_sureness_is_shown_all_the_same(tiny_store: Dataset) -> None:
    with pytest.warns(UserWarning, match="neither says how sure it is"):
        run = dfdbench.run(grey, tiny_store, limit=1, protocol="sure", keep_predictions=False)
    assert run.protocol == "valid"
    assert len(run.table()) > 0
    with pytest.raises(ResultError, match="no depth maps were kept"):
        list(run.predictions)


def test_a_copy_of_a_run_says_that_its_temporary_folder_is_gone(tiny_store: Dataset) -> None:
    alone = copy.deepcopy(dfdbench.run("constant", tiny_store, limit=1))
    with pytest.raises(ResultError, match=r"folder is gone .*\n.*out=FOLDER"):
        list(alone.predictions)


def test_a_run_is_saved_and_opened_again(done: dfdbench.Run, tmp_path: Path) -> None:
    folder = done.save(tmp_path / "kept")
    assert dfdbench.open_run(folder).scores.equals(done.scores)
    with pytest.raises(InputError, match="write into a run"):
        done.save(folder)
    (tmp_path / "file").touch()
    for write in (done.report, done.save):
        with pytest.raises(DfdbenchError):
            write(tmp_path / "file")
        with pytest.raises(ResultError, match="cannot write the r"):
            write(tmp_path / "file/below")
    with pytest.raises(ResultError):
        dfdbench.open_run(tmp_path)


def test_of_tracks_the_runs_of_one_method_are_opened(
    done: dfdbench.Run, tiny_store: Dataset, tmp_path: Path
) -> None:
    for label in ("clean", "noise-2", "clean.previous-2", "noise-2.previous-2"):
        done.save(tmp_path / label)
    dfdbench.run("constant", tiny_store, out=tmp_path / "noise-1")
    assert list(dfdbench.open_run(tmp_path).results) == ["clean", "noise-2"]


def test_runs_compare_with_the_first(done: dfdbench.Run, tiny_store: Dataset) -> None:
    found = dfdbench.compare(done, dfdbench.run("constant", tiny_store), protocol="thesis")
    assert found.figure() is not None  # the second run lasts as long as what compares it
    assert set(found.scores["run"]) == {0, 1}
    one, other = (each.result.mean("thesis", "nrmse") for each in found.runs)
    assert found.table()["difference"].iloc[0] == pytest.approx((other or 0) - (one or 0))
    assert found.table()["low"].dtype == float  # all of them unknown, with so few scenes
    with pytest.raises(InputError, match="two runs"):
        dfdbench.compare(done)
    tracks = dfdbench.Run(dict.fromkeys(("clean", "gain-1"), done._first))
    with pytest.warns(UserWarning, match="only its clean"), pytest.raises(InputError, match="two"):
        dfdbench.compare(tracks)
    with pytest.raises(InputError, match=r"not a run .*: got list\n.*compare\(\*runs\)"):
        dfdbench.compare([done, done])  # type: ignore[arg-type]


def test_a_run_and_scored_maps_warn_of_their_unit(tiny_store: Dataset, tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="between 0 and 1"):
        dfdbench.run(lambda infocus, defocus: infocus.mean(2) / 255, tiny_store)
    (tmp_path / "maps").mkdir()
    for pair in tiny_store.pairs("test"):
        np.save(tmp_path / "maps" / pair.id.replace("/", "_"), tiny_store.read(pair).levels / 255)
    with pytest.warns(UserWarning, match="between 0 and 1"):
        dfdbench.score(tmp_path / "maps", tiny_store)


def test_what_no_run_takes_says_why(tiny_store: Dataset) -> None:
    for limit in (0, 2.5, "3"):
        with pytest.raises(InputError, match="a whole number from 1"):
            dfdbench.run("constant", tiny_store, limit=limit)  # type: ignore[arg-type]
    with pytest.raises(MethodError, match=r"\(parameter gain\): got array"):
        dfdbench.run(lambda a, b, gain: a, tiny_store, parameters={"gain": np.ones(2)})


def test_a_build_warns_of_what_is_missing(tiny_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "tiny-1.toml").write_text(TINY_TOML)
    (tiny_folder / "Two/Illum1/Exp1/view1.png").unlink()
    with pytest.warns(UserWarning, match="missing"):
        data = dfdbench.build(str(tmp_path / "tiny-1.toml"), tiny_folder, store=tmp_path / "t.zarr")
    assert len(data.captures()) < 11
    assert data.verify().sound
