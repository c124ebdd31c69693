from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.evaluation.run import run_method
from dfdbench.figures.sureness import Curves, curves_of, sureness_figure
from dfdbench.methods.method import Method
from dfdbench.results.record import RESULT
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.summary import summarise
from tests.made_folder import built
from tests.made_stack_folder import make_stacks


def sure(infocus: Any, defocus: Any) -> Any:
    depth = infocus[..., 0] / 2
    sigma = 1.0 + defocus[..., 1]
    depth[:6] = np.nan
    return depth, sigma


def test_the_lines_are_what_the_protocol_scores(tiny_store: Dataset, tmp_path: Path) -> None:
    method = Method("mine", "m:sure", sure)
    result = run_method(tiny_store, method, "test", tmp_path / "run").result
    saved = SavedRun(tmp_path / "run" / RESULT, result, tiny_store, "")
    found = curves_of(saved, "mine")
    assert found is not None
    means = {
        name: np.mean([pair.score("sure", name) or np.nan for pair in result.pairs])
        for name in ("nrmse_50", "within_90", "density")
    }
    assert found.errors[24] == pytest.approx(means["nrmse_50"])
    assert found.held is not None
    assert found.held[17] == pytest.approx(means["within_90"])
    # What has no answer has no error either.
    assert means["density"] < 0.9
    assert np.isnan(found.errors[-1])
    defined = ~np.isnan(found.errors)
    assert (found.least[defined] <= found.errors[defined] + 1e-12).all()
    figure = sureness_figure([found, Curves("$x$", found.errors, found.least, None)], "tiny")
    left, right = figure.axes
    assert (len(left.get_lines()), len(right.get_lines())) == (4, 2)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["mine", r"\$x\$"]
    assert not summarise(result, "valid").ranked
    # Who kept nothing or says nothing has no lines.
    (tmp_path / "elsewhere").mkdir()
    assert curves_of(replace(saved, path=tmp_path / "elsewhere" / RESULT), "mine") is None
    plain = Method("plain", "m:plain", lambda infocus, defocus: infocus[..., 0] / 2)
    result = run_method(tiny_store, plain, "test", tmp_path / "plain").result
    assert curves_of(SavedRun(tmp_path / "plain" / RESULT, result, tiny_store, ""), "plain") is None


def test_metres_that_are_not_known_do_not_count(tmp_path: Path) -> None:
    def predict(stack: Any) -> Any:
        return np.full(stack.shape[1:3], 2.0), stack[1, ..., 0] + 1.0

    predict.unit = "metres"  # type: ignore[attr-defined]
    _, store = built(make_stacks(tmp_path / "mine"))
    assert np.isnan(store.captures("test")[0].depth).any()
    method, folder = Method("mine", "m:predict", predict), tmp_path / "run"
    result = run_method(store, method, "test", folder).result
    found = curves_of(SavedRun(folder / RESULT, result, store, ""), "mine")
    assert found is not None
    assert found.errors[24] == pytest.approx(result.pairs[0].score("sure", "nrmse_50"))
