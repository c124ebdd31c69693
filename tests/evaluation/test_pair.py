import pickle
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import MethodError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.pair import PairEvaluator, RemoteEvaluator
from dfdbench.evaluation.predict import predict
from dfdbench.methods.registry import load_method
from tests.evaluation.made_methods import method


def test_another_process_gives_the_same_but_time(
    tiny_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "mine.py"
    file.write_text("def half(infocus, defocus):\n    return infocus[..., 0] / 2\n")
    loaded = load_for(tiny_store, f"{file}:half", {})
    pair = tiny_store.pairs("One")[0]
    here, answer = PairEvaluator(tiny_store, loaded, 0)(pair)
    remote = pickle.loads(pickle.dumps(RemoteEvaluator.of(tiny_store, loaded, 0)))
    there, other, used, _ = remote(pair)
    assert used == loaded.used
    assert Path(remote.place).is_absolute()
    monkeypatch.chdir(tmp_path)
    near = load_for(tiny_store, "mine.py:half", {})
    assert RemoteEvaluator.of(tiny_store, near, 0).entry == f"{file}:half"
    assert other.depth is not None
    assert answer.depth is not None
    assert np.array_equal(other.depth, answer.depth)
    assert (here.timed_alone, there.timed_alone) == (True, False)
    blank = {"seconds": None, "timed_alone": True}
    assert there.model_copy(update=blank) == here.model_copy(update=blank)
    remote = RemoteEvaluator.of(tiny_store, loaded, seed=1)
    file.write_text("def half(infocus, defocus):\n    return infocus[..., 0] / 3\n")
    with pytest.raises(MethodError, match="another version of the method") as told:
        remote(pair)
    assert "mine.py has changed" in str(told.value)


def test_a_pair_draws_the_same_numbers_whatever_came_before(tiny_store: Dataset) -> None:
    def drawing(infocus: Any, defocus: Any) -> Any:
        return np.random.uniform(0, 255, infocus.shape[:2])

    pair, other = tiny_store.pairs("One")[:2]
    evaluate = PairEvaluator(tiny_store, method(drawing), 3)
    first = evaluate(pair)[0].prediction_sha256
    evaluate(other)
    assert evaluate(pair)[0].prediction_sha256 == first
    assert PairEvaluator(tiny_store, method(drawing), 4)(pair)[0].prediction_sha256 != first


def test_calls_in_threads_wait_for_one_another(tiny_store: Dataset) -> None:
    def drawing(infocus: Any, defocus: Any) -> Any:
        return sum(np.random.rand(*infocus.shape[:2]) for _ in range(50))

    class Fitted:
        def fit(self, pairs: Any) -> dict[str, float]:
            return {"drawn": float(np.mean([np.random.rand() for _ in range(5000)]))}

        def restore(self, learned: Any) -> None:
            self.drawn = learned["drawn"]

        __call__ = staticmethod(drawing)

    pair = tiny_store.pairs("One")[0]
    images = tiny_store.read(pair)
    calls: list[Callable[[], object]] = [
        lambda: PairEvaluator(tiny_store, method(drawing), 0)(pair)[0].prediction_sha256,
        lambda: predict(drawing, (images.infocus, images.defocus), align=False).tobytes(),
        lambda: load_method(Fitted(), {}, {}).fit([images]).predict.drawn,  # type: ignore[attr-defined]
    ]
    alone, printed = [call() for call in calls], sys.stdout
    with ThreadPoolExecutor(3) as threads:
        together = [list(threads.map(lambda call: call(), calls)) for _ in range(10)]
    assert together == [alone] * 10
    assert sys.stdout is printed


def test_a_call_that_waits_for_long_says_why(
    tiny_store: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dfdbench.methods.process_state._PATIENCE", 0.05)
    images = tiny_store.read(tiny_store.pairs("One")[0])
    pair = images.infocus, images.defocus

    def slow(infocus: Any, defocus: Any) -> Any:
        time.sleep(0.5)
        return infocus[..., 0]

    with ThreadPoolExecutor(1) as thread:
        thread.submit(predict, slow, pair, align=False)
        time.sleep(0.1)
        with pytest.warns(UserWarning, match="threads of its own"):
            predict("local", pair, "published", align=False)
