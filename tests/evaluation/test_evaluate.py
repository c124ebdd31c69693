import gc
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dfdbench
from dfdbench.api import run as evaluate
from dfdbench.blur.law import BlurLaw
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import InputError, MethodError, ResultError, UnknownNameError
from dfdbench.evaluation.evaluate import best_settings, by_name, score_predictions, without_track
from dfdbench.evaluation.predict import DepthPredictor
from dfdbench.evaluation.run import run_method
from dfdbench.methods.measured_law import Calibration
from dfdbench.results.record import load_result
from dfdbench.results.run_folder import read_prediction
from dfdbench.results.run_tables import all_tables
from dfdbench.results.saved_run import open_saved_run
from dfdbench.results.summary import summarise
from tests.conftest import store_of
from tests.evaluation.made_methods import grey as red
from tests.evaluation.made_methods import method
from tests.evaluation.made_predictions import in_metres, write_all
from tests.made_stack_folder import STACK_TOML, make_stacks


def grey(infocus: Any, defocus: Any, gain: float = 1.0) -> Any:
    return np.clip(gain * infocus.mean(axis=2), 0, 255)


class Level:
    """One level everywhere: the mean depth of the training split unless it is told another."""

    def __init__(self, training_mean: float) -> None:
        self.level = training_mean

    def __call__(self, infocus: Any, defocus: Any) -> Any:
        return np.full(infocus.shape[:2], self.level)


class Measured(Level):
    """It has measured as many laws as it is told."""

    def __init__(self, training_mean: float, laws: int = 1) -> None:
        super().__init__(training_mean)
        nothing = np.full(256, np.nan), np.zeros(256, np.int64), np.full(256, np.nan)
        law = BlurLaw((0.5,) * 256, noise=(1.0,))
        self.calibrations = (Calibration(law, *nothing),) * laws


def test_of_a_built_set_the_tracks_are_had_by_its_toml_file(tiny_store: Dataset) -> None:
    given: list[Any] = [str(tiny_store.path), tiny_store]
    for each in given:
        with pytest.raises(InputError, match="Fix: name its TOML file"):
            dfdbench.run_tracks("constant", each)
    with pytest.raises(InputError, match="built from a set's manifest"):
        without_track(str(tiny_store.path))
    for name in ("demo", "unseen-7"):
        assert by_name(find_manifest(name)) == f"name {name}"


def test_each_measured_law_lies_beside_the_run(tiny_store: Dataset, tmp_path: Path) -> None:
    for laws, files in enumerate(([], ["law.toml"], ["law-1.toml", "law-2.toml"])):
        run = evaluate(Measured, tiny_store, limit=1, parameters={"laws": laws})
        assert sorted(path.name for path in run.folder.glob("law*")) == files
        assert all("sigmas" in (run.folder / name).read_text() for name in files)


def test_what_has_no_name_is_run_with_its_facts_and_parameters(tiny_store: Dataset) -> None:
    def local(infocus: Any, defocus: Any, gain: float) -> Any:
        return grey(infocus, defocus, gain)

    named = evaluate(grey, tiny_store, parameters={"gain": 0.5})
    unnamed = evaluate(local, str(tiny_store.path), parameters={"gain": 0.5})
    assert unnamed.result.averages == named.result.averages
    assert unnamed.result.method.parameters == {"gain": 0.5}
    assert unnamed.result.method.entry.endswith("<locals>.local")
    assert unnamed.result.method.source_sha256 is None
    assert named.result.method.source_sha256 is not None

    mean = evaluate("constant", tiny_store).result.averages

    class Here(Level):
        pass

    kind = evaluate(Here, tiny_store)
    assert (kind.result.method.uses, kind.result.averages) == (["training_mean"], mean)
    thing = evaluate(Level(90.0), tiny_store, "One")
    assert thing.result.averages != mean
    assert thing.result.method.uses == []


@pytest.mark.parametrize("value", [{1: 2}, {"a": {1: 2}}, (1.0, float("nan")), object()])
def test_what_no_result_can_keep_is_refused_before_the_run(tiny_store: Dataset, value: Any) -> None:
    def predict(infocus: Any, defocus: Any, value: Any) -> Any:
        raise AssertionError

    with pytest.raises(MethodError, match="no result can keep this"):
        evaluate(predict, tiny_store, parameters={"value": value})


def test_a_changed_function_is_another_run_which_never_passes_for_the_first(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    runs = []
    for level in (10.0, 120.0):

        def constant(infocus: Any, defocus: Any, level: float = level) -> Any:
            return np.full(infocus.shape[:2], level)

        runs.append(evaluate(constant, tiny_store, out=tmp_path / "run"))
    first, second = runs
    assert first.result.averages != second.result.averages
    pair = first.result.pairs[0].id
    uses = (lambda: first.images(pair), first.draw, lambda: first.save(tmp_path / "new"))
    for use in (*uses, lambda: dfdbench.compare(first, second)):
        with pytest.raises(ResultError, match=r"another run than this(.|\n)*run\.previous"):
            use()
    assert not (tmp_path / "new").exists()
    assert second.images(pair)[1].max() == 120


def test_depth_maps_live_as_long_as_the_run_or_in_out(tiny_store: Dataset, tmp_path: Path) -> None:
    done: list[tuple[int, int, str]] = []
    run = evaluate(grey, tiny_store, limit=2, on_pair=lambda *counts: done.append(counts))
    scores = [pair.scores["valid"]["nrmse"] or 0 for pair in run.result.pairs if pair.scores]
    means = [f"NRMSE {np.mean(scores[:count]):.4f}" for count in (1, 2)]
    assert done == [(1, 2, means[0]), (2, 2, means[1])]
    images, prediction = run.images(run.result.pairs[0].id)
    np.testing.assert_allclose(prediction, grey(images.infocus, images.defocus), rtol=1e-6)
    folder = run.folder
    del run, images, prediction
    gc.collect()
    assert not folder.exists()
    kept = evaluate(grey, tiny_store, limit=2, out=tmp_path / "kept")
    del kept
    gc.collect()
    again = open_saved_run(str(tmp_path / "kept"))
    found = again.images(again.result.pairs[0].id)
    assert found is not None
    assert found[0].pair.id == again.result.pairs[0].id
    with pytest.raises(UnknownNameError, match="Desk"):
        again.images("Desk")


def test_it_scores_as_a_run_does_and_says_not_run(tiny_store: Dataset, tmp_path: Path) -> None:
    ran = run_method(tiny_store, method(red), "test", tmp_path / "run").result
    for pair in tiny_store.pairs("test"):
        path = tmp_path / "made" / f"{pair.id}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, tiny_store.read(pair).infocus[..., 0])
    done = score_predictions(tmp_path / "made", tiny_store, "test", tmp_path / "out", "mine")
    result = load_result(done.folder)
    assert result == done.result
    assert (result.averages, result.protocols) == (ran.averages, ran.protocols)
    for mine, its in zip(result.pairs, ran.pairs, strict=True):
        assert (mine.scores, mine.prediction_sha256) == (its.scores, its.prediction_sha256)
        assert (mine.warnings, mine.seconds) == (its.warnings, None)
    assert (result.method.scored, result.method.source_sha256) == ("levels", None)
    titles = [table.title for table in all_tables(summarise(result, "thesis"), None)]
    assert titles[0].startswith("mine (scored, not run) on tiny-1")
    assert not any("seconds" in title for title in titles)
    pair = tiny_store.pairs("test")[0]
    kept = read_prediction(done.folder, pair, tiny_store.shape_of(pair.scene))
    assert kept is not None
    np.testing.assert_array_equal(kept, tiny_store.read(pair).infocus[..., 0])
    with pytest.raises(InputError, match="no name for a method"):
        score_predictions(tmp_path / "made", tiny_store, "test", tmp_path / "new", "a\nb")
    with pytest.raises(UnknownNameError, match=r"unknown unit: got meters\nFix: .* metres"):
        dfdbench.score(tmp_path / "made", tiny_store, unit="meters")  # type: ignore[arg-type]
    path.unlink()
    with pytest.raises(ResultError, match="pairs without a depth map: 1"):
        score_predictions(tmp_path / "made", tiny_store, "test", tmp_path / "new", "mine")
    assert not (tmp_path / "new").exists()


def test_what_looks_like_another_unit_is_said(tiny_store: Dataset, tmp_path: Path) -> None:
    write_all(tiny_store, "all", tmp_path / "a", lambda stem, d: np.save(f"{stem}.npy", d / 255))
    said = score_predictions(tmp_path / "a", tiny_store, "test", tmp_path / "out", "mine").result
    assert any("all levels between 0 and 10; levels go" in text for text in said.warnings)
    assert "4 files are of other pairs of the set, and were not scored" in said.warnings
    store, _ = in_metres(tiny_store)
    write_all(store, "test", tmp_path / "b", lambda stem, d: np.save(f"{stem}.npy", 1 + d / 200))
    done = score_predictions(tmp_path / "b", store, "test", tmp_path / "out", "mine", "metres")
    assert (done.set_aside, done.result.method.scored) == (tmp_path / "out.previous", "metres")
    (told,) = [text for text in done.result.warnings if "beyond" in text]
    assert told.startswith("over a tenth of the pixels lie beyond the set's ends, and count as the")


@pytest.fixture(scope="module")
def of_stacks(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A set of stacks, scored in metres; never changed."""
    folder = tmp_path_factory.mktemp("stacks")
    manifest = parse_manifest(STACK_TOML.encode(), "mine-1.toml")
    return store_of(manifest, make_stacks(folder / "mine"), folder / "one.zarr")


def test_millimetres_for_metres_are_scored_and_told(
    of_stacks: Dataset, tiny_store: Dataset
) -> None:
    def far(*images: Any) -> Any:
        return np.full(images[0].shape[-3:-1], 9000.0)

    far.unit = "metres"  # type: ignore[attr-defined]
    for store in (of_stacks, in_metres(tiny_store)[0]):
        warnings = evaluate(far, store).result.warnings
        assert "are these metres?" in warnings[-1]
        assert warnings[-1].startswith("over a tenth of the pixels lie beyond the set's ends")
        assert not any("multiply" in text for text in warnings)


def test_a_set_in_metres_wants_levels_one_way_and_metres_the_other(of_stacks: Dataset) -> None:
    def falls(*images: Any) -> Any:
        rows, columns = images[0].shape[-3:-1]
        # The floor is nearer further down.
        return np.repeat(np.linspace(1, 4, rows)[:, np.newaxis], columns, axis=1)

    falls.unit = "metres"  # type: ignore[attr-defined]
    (told,) = evaluate(falls, of_stacks).result.warnings
    assert told.endswith("pairs: mine-1 wants brighter for nearer, and metres larger for farther")


def test_a_second_answer_in_metres_is_not_off_by_levels(of_stacks: Dataset) -> None:
    calls = []

    def drifts(*images: Any) -> Any:
        calls.append(1)
        return np.full(images[0].shape[-3:-1], 1 + len(calls) / 2)

    drifts.unit = "metres"  # type: ignore[attr-defined]
    (told,) = evaluate(drifts, of_stacks).result.warnings
    assert ", by up to 1 (" in told


def test_what_lies_beyond_the_ends_of_a_set_in_metres_is_told_of_scored_maps(
    of_stacks: Dataset, tmp_path: Path
) -> None:
    def far(stem: Path, levels: Any) -> None:
        np.save(f"{stem}.npy", np.where(levels < 90, 9.0, 2.0))

    maps = tmp_path / "maps"
    made = write_all(of_stacks, "test", maps, far)
    done = score_predictions(maps, of_stacks, "test", tmp_path / "out", "mine", "metres")
    assert all(np.mean(levels < 90) > 0.1 for levels in made.values())
    (told,) = [text for text in done.result.warnings if "beyond" in text]
    assert told.endswith(f"count as the end: are these metres? ({len(made)} pairs)")


def test_metres_for_levels_are_told_on_a_set_in_metres_too(of_stacks: Dataset) -> None:
    def near(*images: Any) -> Any:
        return np.full(images[0].shape[-3:-1], 2.5)

    (told,) = evaluate(near, of_stacks).result.warnings
    assert told.startswith("all levels between 0 and 10")
    assert "is it in metres" in told


def test_what_knows_pairs_and_stacks_is_warmed_up_on_a_pair(of_stacks: Dataset) -> None:
    warmed = []

    class Both:
        def warm_up(self, infocus: Any, defocus: Any) -> None:
            warmed.append(infocus.shape == defocus.shape)

        def __call__(self, infocus: Any, defocus: Any) -> Any:
            raise AssertionError

        def from_stack(self, stack: Any) -> Any:
            return np.full(stack.shape[1:3], 90.0)

    evaluate(Both(), of_stacks)
    assert warmed == [True]


def test_a_fit_on_a_set_of_one_s_own_knows_its_scale(of_stacks: Dataset, tmp_path: Path) -> None:
    evaluate("s-transform", of_stacks, out=tmp_path / "run")
    assert "0.5 m" in DepthPredictor(None, tmp_path / "run").meaning


#: Answers with the training mean and an error of its own; it writes down what it sees.
OFF = """
import numpy as np

class Off:
    ranges = {"off": (30, 0, 10)}

    def __init__(self, log="", off=0, peek=False):
        self.off, self.log, self.peek = off, log, peek

    def fit(self, pairs):
        assert not hasattr(self, "scenes"), "it still knows the captures of another fold"
        self.scenes = sorted({pair.pair.scene for pair in pairs})
        return {"level": np.mean([pair.levels[pair.valid].mean() for pair in pairs])}

    def restore(self, learned):
        self.level = learned["level"]

    def __call__(self, infocus, defocus):
        if self.peek:
            raise ValueError("no such thing")
        with open(self.log, "a") as file:
            file.write(f"{infocus.sum()} {' '.join(self.scenes)}\\n")
        return np.full(infocus.shape[:2], self.level + self.off, np.float32)
"""


@pytest.fixture
def off(tmp_path: Path) -> str:
    path = tmp_path / "off.py"
    path.write_text(OFF)
    return f"{path}:Off"


def test_no_capture_is_scored_by_its_own_group(few_demo: Dataset, off: str, tmp_path: Path) -> None:
    log = tmp_path / "log"
    tried = dfdbench.tune(off, few_demo, parameters={"log": str(log)}, protocol="valid")
    # Off by nothing is best, and what is off by most comes last.
    assert (tried.index.names, tried.index.tolist()) == (["off"], [0, 10, 30])
    captures = {str(each.infocus.sum()): each.pair.scene for each in few_demo.captures("train")}
    lines = [line.split() for line in log.read_text().splitlines()]
    assert len(lines) == 3 * len(captures) == 3 * len({image for image, *_ in lines})
    train = set(few_demo.manifest.scenes_of("train"))
    for image, *fitted in lines:
        assert captures[image] not in fitted
        assert set(fitted) < train


def test_ranges_are_crossed_and_few_captures_looked_at(few_demo: Dataset, off: str) -> None:
    # What is to be tried needs no default.
    Path(off.partition(":")[0]).write_text(OFF.replace('log="", off=0', 'off, log=""'))
    ranges: dict[str, Any] = {"off": np.array([30, 0]), "peek": [np.False_]}
    seen: list[int] = []
    given: Any = {"limit": 6, "on_pair": lambda *numbers: seen.extend(numbers)}
    tried = dfdbench.tune(off, few_demo, ranges, parameters={"log": "/dev/null"}, **given)
    assert tried.index.tolist() == [(0, False), (30, False)]
    assert seen[-2:] == [12, 12]
    ranges = {"off": [2, 0.5], "peek": [None]}
    tried = dfdbench.tune(off, few_demo, ranges, parameters={"log": "/dev/null"}, limit=1)
    assert best_settings(tried) in [[f"off={off}", "peek=null"] for off in (2, 0.5)]


def test_few_captures_are_of_every_illumination(demo_store: Dataset, tmp_path: Path) -> None:
    def grey_of(infocus: Any, defocus: Any, power: int) -> Any:
        seen.add(int(infocus.sum()))
        return infocus.mean(axis=2) ** power

    seen = set[int]()
    dfdbench.tune(grey_of, demo_store, {"power": [1]}, limit=18)
    every = {int(each.infocus.sum()): each.pair.at for each in demo_store.captures("train")}
    assert {every[image]["illumination"] for image in seen} == {1, 2, 3}
    assert {every[image]["exposure"] for image in seen} == {0, 1, 2}


def test_leaving_pixels_out_wins_nothing(few_demo: Dataset) -> None:
    def some(infocus: Any, defocus: Any, share: float) -> Any:
        depth = infocus.mean(axis=2)
        depth[: round(share * len(depth))] = np.nan
        return depth

    with pytest.raises(MethodError, match=r"too many pixels have no answer.*\nFix: leave these"):
        dfdbench.tune(some, few_demo, {"share": [0.8]}, protocol="sure", limit=2)


def test_what_cannot_be_tried_says_why(few_demo: Dataset, tiny_store: Dataset, off: str) -> None:
    with pytest.raises(InputError, match="1 groups of training captures are too few for 4 folds"):
        dfdbench.tune(off, tiny_store)
    for values in ("12", 12):
        with pytest.raises(InputError, match=r"give a list: {'off': \['?12'?\]}"):
            dfdbench.tune(off, few_demo, {"off": values})  # type: ignore[dict-item]
    with pytest.raises(MethodError, match="strength"):
        dfdbench.tune(off, few_demo, {"strength": [1, 2]})
    with pytest.raises(InputError, match=r"to try is empty \(off\)"):
        dfdbench.tune(off, few_demo, {"off": []})
    with pytest.raises(MethodError, match="no such thing"):
        dfdbench.tune(off, few_demo, {"peek": [True]})


def test_an_object_that_cannot_be_copied_is_not_fitted_fold_by_fold(few_demo: Dataset) -> None:
    class Locked:
        def __init__(self) -> None:
            self.lock = threading.Lock()

        def __call__(self, infocus: Any, defocus: Any, power: int) -> Any:
            return infocus.mean(axis=2) ** power

    assert len(dfdbench.tune(Locked(), few_demo, {"power": [1]}, limit=1)) == 1

    class Mean:
        def fit(self, pairs: Any) -> None:
            assert not hasattr(self, "level"), "it still knows the captures of another fold"
            self.level = float(np.mean([pair.depth[pair.valid].mean() for pair in pairs]))

        def __call__(self, infocus: Any, defocus: Any, times: float) -> Any:
            return np.full(infocus.shape[:2], times * self.level)

    assert dfdbench.tune(Mean(), few_demo, {"times": [0.5, 1.0]}).index.tolist() == [1.0, 0.5]
    fits = type("Fits", (Locked,), {"fit": print})()
    with pytest.raises(MethodError, match=r"cannot be copied.*\n.*Fix: give its class"):
        dfdbench.tune(fits, few_demo, {"power": [1]}, limit=1)
