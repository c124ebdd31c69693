import os
import shutil
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.fingerprint import array_digest
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError, MethodError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import RunDone, run_method
from dfdbench.methods.registry import load_method
from dfdbench.metrics.protocol import PROTOCOLS, score
from dfdbench.results.environment import describe_environment
from dfdbench.results.record import RESULT, load_result
from dfdbench.results.run_folder import PREDICTIONS, read_prediction
from dfdbench.system.parallel import Cluster, Pool, Processes
from tests.conftest import ON_SERVERS, store_of
from tests.evaluation.made_methods import Counting, method


def test_a_run_predicts_once_for_every_protocol(tiny_store: Dataset, tmp_path: Path) -> None:
    predict = Counting()
    run = run_method(tiny_store, method(predict), "test", tmp_path / "out")
    # One more, to see whether the first answer comes again.
    assert (predict.calls, predict.warmed) == (8, 1)
    assert run.result.complete
    assert load_result(tmp_path / "out" / RESULT) == run.result
    for pair, record in zip(tiny_store.pairs("test"), run.result.pairs, strict=True):
        images = tiny_store.read(pair)
        kept = read_prediction(tmp_path / "out", pair, tiny_store.shape_of(pair.scene))
        assert kept is not None
        assert np.array_equal(kept, images.infocus[..., 0].astype(np.float32) / 2)
        assert record.prediction_sha256 == array_digest("depth", ("y", "x"), kept)
        for name, protocol in PROTOCOLS.items():
            expected = score(protocol, images.levels, images.valid, kept, 16)
            assert record.scores[name]["nrmse"] == expected["nrmse"]
            assert record.scores[name]["ssim"] == expected["ssim"]
    recorded = run.result.dataset
    assert (recorded.fingerprint, recorded.split) == (tiny_store.fingerprint, "test")
    assert (recorded.expected, recorded.evaluated) == (7, 7)
    # Others find the depth maps by their coordinates.
    maps = xarray.open_zarr(tmp_path / "out" / PREDICTIONS, group="Three", consolidated=False)
    assert pair.at == {"view": 5, "illumination": 1, "exposure": 0}
    assert np.array_equal(maps["depth"].sel(pair.at).values, images.infocus[..., 0] / 2)
    with pytest.raises(KeyError):
        maps["depth"].sel(view=2)


def test_a_stopped_run_goes_on(tiny_store: Dataset, tmp_path: Path) -> None:
    whole = run_method(tiny_store, method(Counting()), "test", tmp_path / "whole").result
    with pytest.raises(KeyboardInterrupt):
        run_method(tiny_store, method(Counting(stop_at=5)), "test", tmp_path / "out")
    with (tmp_path / "out/pairs.jsonl").open("a") as journal:
        journal.write('{"id": "cut sh')
    again = Counting()
    run = run_method(tiny_store, method(again), "test", tmp_path / "out")
    assert run.reused == 3
    assert again.calls == 5
    assert [pair.scores for pair in run.result.pairs] == [pair.scores for pair in whole.pairs]


def test_a_failed_pair_is_recorded_and_tried_again(tiny_store: Dataset, tmp_path: Path) -> None:
    run = run_method(tiny_store, method(Counting(fail_at=4)), "test", tmp_path / "out")
    (failed,) = [pair for pair in run.result.pairs if pair.status == "failed"]
    assert str(failed.error).startswith("raised RuntimeError: out of memory (")
    assert run.result.averages is None
    assert run.result.dataset.evaluated == 6
    load_result(tmp_path / "out" / RESULT)
    again = Counting()
    second = run_method(tiny_store, method(again), "test", tmp_path / "out")
    assert again.calls == 2
    assert second.result.complete
    # Depth maps that were removed are made again.
    shutil.rmtree(tmp_path / "out" / PREDICTIONS)
    third = run_method(tiny_store, method(Counting()), "test", tmp_path / "out")
    assert (third.reused, third.result.complete) == (0, True)
    first = min((tmp_path / "out" / PREDICTIONS).glob("*/depth/c.*"))
    first.unlink()
    assert run_method(tiny_store, method(Counting()), "test", tmp_path / "out").reused == 6
    assert first.exists()
    # A cluster that does not answer moves nothing aside.
    local, nowhere = load_method("local", {}, {}), Cluster("nowhere")
    with pytest.raises(InputError, match="not a scheduler's address"):
        run_method(tiny_store, local, "test", tmp_path / "out", pool=nowhere)
    assert not (tmp_path / "out.previous").exists()


MIXED = """
import json
from pathlib import Path
import numpy as np
import mixed_helper

def predict(infocus, defocus):
    level = json.loads((Path(__file__).parent / "coef.json").read_text())
    return np.full(infocus.shape[:2], level)
"""


def test_a_run_takes_nothing_over_from_another_method(
    tiny_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(**options: Any) -> RunDone:
        # As another process would.
        monkeypatch.delitem(sys.modules, "mixed_helper", raising=False)
        loaded = load_for(tiny_store, f"{tmp_path / 'mixed.py'}:predict", {})
        return run_method(tiny_store, loaded, "test", out, RunOptions(**options))

    for limit, edited in ((3, "mixed_helper.py"), (None, "coef.json")):
        for name, text in {"mixed.py": MIXED, "mixed_helper.py": "", "coef.json": "10"}.items():
            (tmp_path / name).write_text(text)
        out = tmp_path / f"limit {limit}"
        first = run(limit=limit)
        old = (out / RESULT).read_text()
        again = run(limit=limit)
        assert (again.reused, again.because) == (first.result.dataset.evaluated, ())
        (tmp_path / edited).write_text("20")
        other = run()
        assert (other.reused, other.because) == (0, (f"{edited} has changed",))
        assert other.set_aside == Path(f"{out}.previous")
        assert run().reused == 7
        fresh = run(fresh=True)
        assert (fresh.reused, fresh.set_aside) == (0, Path(f"{out}.previous-2"))
        assert (Path(f"{out}.previous") / RESULT).read_text() == old


def test_runs_in_threads_wait_for_one_another(tiny_store: Dataset, tmp_path: Path) -> None:
    def drawn(infocus: Any, defocus: Any) -> Any:
        time.sleep(0.01)
        return np.random.uniform(0, 255, infocus.shape[:2])

    def run(name: str) -> list[Any]:
        done = run_method(tiny_store, method(drawn), "test", tmp_path / name)
        return [pair.scores for pair in done.result.pairs]

    out = sys.stdout
    with ThreadPoolExecutor(2) as threads:
        assert [*threads.map(run, "ab")] == [run("c")] * 2
    assert sys.stdout is out


def test_a_file_edited_during_a_run_is_told(tiny_store: Dataset, tmp_path: Path) -> None:
    (tmp_path / "mixed.py").write_text(MIXED.replace("import mixed_helper", ""))
    (tmp_path / "coef.json").write_text("10")
    loaded = load_for(tiny_store, f"{tmp_path / 'mixed.py'}:predict", {})

    def edit(done: int, *_: object) -> None:
        (tmp_path / "coef.json").write_text(str(done))

    run = run_method(tiny_store, loaded, "test", tmp_path / "out", on_pair=edit)
    assert run.result.warnings[-1].startswith("coef.json has changed while it was run")


def test_a_limited_run_is_completed_and_each_pair_keeps_the_machine_that_it_was_run_on(
    tiny_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = describe_environment()
    run = run_method(tiny_store, method(Counting()), "test", tmp_path / "out", RunOptions(limit=2))
    assert [pair.status for pair in run.result.pairs] == ["ok"] * 2 + ["not-run"] * 5
    assert run.result.averages is None
    there = here.model_copy(update={"cpu": "another"})
    monkeypatch.setattr("dfdbench.evaluation.run.describe_environment", lambda: there)
    run_method(tiny_store, method(Counting()), "test", tmp_path / "out", RunOptions(limit=4))
    monkeypatch.undo()
    run = run_method(tiny_store, method(Counting()), "test", tmp_path / "out")
    result = run.result
    assert run.reused == 4
    assert result.averages is not None
    assert [pair.machine for pair in result.pairs] == [0, 0, 1, 1, 0, 0, 0]
    assert [each.cpu for each in result.environments] == [here.cpu, "another"]
    assert "run on 2 machines: times are not comparable" in str(result.warnings)
    assert load_result(tmp_path / "out") == result
    run = run_method(tiny_store, method(Counting()), "test", tmp_path / "out", RunOptions(limit=2))
    assert (run.reused, run.result.complete) == (7, True)


def test_answers_that_differ_by_call_are_told(tiny_store: Dataset, tmp_path: Path) -> None:
    random = np.random.default_rng(0)

    def drawing(infocus: Any, defocus: Any) -> Any:
        return random.uniform(0, 255, infocus.shape[:2])

    options = RunOptions(limit=2)
    result = run_method(tiny_store, method(drawing), "test", tmp_path / "out", options).result
    assert result.pairs[0].id in str(result.warnings)
    assert "cannot be reproduced" in str(result.warnings)
    # It is still known when the run has gone on.
    result = run_method(tiny_store, method(drawing), "test", tmp_path / "out").result
    assert result.pairs[0].id in str(result.warnings)


def test_an_answer_left_from_another_pair_is_told(tiny_store: Dataset, tmp_path: Path) -> None:
    kept = [np.zeros((0, 0))]

    def late(infocus: Any, defocus: Any) -> Any:
        kept.append(infocus[..., 0] / 2)
        return kept[-2] if kept[-2].shape == kept[-1].shape else kept[-1]

    options = RunOptions(limit=3)
    result = run_method(tiny_store, method(late), "test", tmp_path / "out", options).result
    assert result.pairs[0].id in str(result.warnings)
    assert "cannot be reproduced" in str(result.warnings)


def test_a_lacking_pair_is_told(tiny_manifest: Manifest, tiny_folder: Path, tmp_path: Path) -> None:
    (tiny_folder / "Two/Illum1/Exp0/view1.png").unlink()
    store = store_of(tiny_manifest, tiny_folder, tmp_path / "s.zarr")
    run = run_method(store, method(Counting()), "test", tmp_path / "out")
    assert [pair.status for pair in run.result.pairs].count("missing") == 1
    assert run.result.averages is None
    lacking = next(pair.id for pair in run.result.pairs if pair.status == "missing")
    assert any("lacks 1 of 7" in text and lacking in text for text in run.result.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("where", ["processes", pytest.param("cluster", marks=ON_SERVERS)])
def test_pairs_at_once_give_the_same_scores_and_say_so(
    tiny_store: Dataset, tmp_path: Path, where: str, request: pytest.FixtureRequest
) -> None:
    (tmp_path / "drawing.py").write_text(
        "import numpy as np\n"
        "def predict(infocus, defocus):\n"
        "    return np.random.uniform(0, 255, infocus.shape[:2])\n"
    )
    loaded = load_for(tiny_store, f"{tmp_path / 'drawing.py'}:predict", {})
    pool: Pool = Processes(2)
    if where == "cluster":
        pool = Cluster(request.getfixturevalue("cluster"))
    run = partial(run_method, tiny_store, loaded, "test", options=RunOptions(seed=3))
    alone, together = run(tmp_path / "alone").result, run(tmp_path / "together", pool=pool).result
    assert [pair.scores for pair in together.pairs] == [pair.scores for pair in alone.pairs]
    assert together.averages == alone.averages
    assert all(pair.timed_alone for pair in alone.pairs)
    assert not any(pair.timed_alone for pair in together.pairs)
    assert any("not comparable" in warning for warning in together.warnings)
    assert not alone.warnings
    hashes = [[pair.prediction_sha256 for pair in run.pairs] for run in (alone, together)]
    assert hashes[0] == hashes[1]
    pair = tiny_store.pairs("test")[1]
    kept = read_prediction(tmp_path / "together", pair, tiny_store.shape_of(pair.scene))
    assert kept is not None
    assert array_digest("depth", ("y", "x"), kept) == together.pairs[1].prediction_sha256


def test_depth_that_goes_the_wrong_way_is_told(tiny_store: Dataset, tmp_path: Path) -> None:
    read = [tiny_store.read(pair) for pair in tiny_store.pairs("test")]
    depths = {images.infocus.tobytes(): images.levels.astype(np.float32) for images in read}

    def warnings(gain: float, offset: float) -> list[str]:
        def predict(infocus: Any, defocus: Any) -> Any:
            return gain * depths[infocus.tobytes()] + offset

        return run_method(tiny_store, method(predict), "test", tmp_path / f"{gain}").result.warnings

    assert not warnings(1, 0)
    (told,) = warnings(-1, 255)
    assert told.startswith("depth falls where the truth rises on 7 of 7 pairs: tiny-1 wants brigh")
    (told,) = warnings(1 / 255, 0)
    assert told.startswith("all levels between 0 and 10; levels go from 0 (far) to 255 (near)")


@pytest.mark.slow
def test_it_is_warmed_up_here_before_workers_start(tiny_store: Dataset, tmp_path: Path) -> None:
    (tmp_path / "warm.py").write_text(
        "import os\n"
        "def warm_up(infocus, defocus):\n"
        f"    with open({str(tmp_path / 'warmed')!r}, 'a') as log:\n"
        "        log.write(f'{os.getpid()} {infocus.shape}\\n')\n"
        "def predict(infocus, defocus):\n"
        "    return infocus[..., 0]\n"
        "predict.warm_up = warm_up\n"
    )
    loaded = load_for(tiny_store, f"{tmp_path / 'warm.py'}:predict", {})
    run_method(tiny_store, loaded, "test", tmp_path / "out", pool=Processes(1))
    nameless = load_for(tiny_store, partial(max), {})
    with pytest.raises(MethodError, match="no other can run it"):
        run_method(tiny_store, nameless, "test", tmp_path, pool=Processes(1))
    shape = tiny_store.read(tiny_store.pairs("test")[0]).infocus.shape
    here, there = (tmp_path / "warmed").read_text("utf-8").splitlines()
    assert here == f"{os.getpid()} {shape}"
    assert there != here
