from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from dfdbench.blur.law import GREYS, BlurLaw
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.cli.screen import progress
from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import WHOLE, Dataset, Region
from dfdbench.datasets.fingerprint import array_digest
from dfdbench.datasets.manifest import Pair
from dfdbench.errors import MethodError, ResultError, StoreError
from dfdbench.evaluation.check import made_pair
from dfdbench.evaluation.fitting import FIT, camera_note, fit_method, read_fit, training_pairs
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import RunDone, run_method
from dfdbench.methods.method import Method
from dfdbench.results.record import load_result
from dfdbench.system.parallel import Pool, Processes
from tests.conftest import TINY_TOML, store_of
from tests.evaluation.made_methods import write_mean


@pytest.fixture
def mean(tmp_path: Path) -> str:
    return write_mean(tmp_path)


Run = Callable[..., RunDone]


@pytest.fixture
def run(tiny_store: Dataset, mean: str, tmp_path: Path) -> Run:
    """Run the mean on the tiny set, into a folder by name."""

    def run(name: str = "out", split: str = "test", **how: Any) -> RunDone:
        method = load_for(tiny_store, mean, {"keep": how.pop("keep", True)})
        pool: Pool | None = how.pop("pool", None)
        place = tmp_path / name
        return run_method(tiny_store, method, split, place, RunOptions(**how), pool=pool)

    return run


def mean_of(store: Dataset, *scenes: str) -> float:
    pairs = [store.read(pair) for scene in scenes for pair in store.pairs(scene)]
    return float(np.mean([pair.depth[pair.valid].mean() for pair in pairs]))


class Guarded(Dataset):
    """A store that raises where a scene is read that it guards."""

    def __init__(self, place: Any, *guarded: str) -> None:
        super().__init__(place)
        self.guarded = guarded

    def read(self, pair: Pair, region: Region = WHOLE) -> Capture:
        assert pair.scene not in self.guarded, f"read {pair.id}"
        return super().read(pair, region)


def test_a_fit_sees_all_training_pairs_and_no_other(tiny_store: Dataset, mean: str) -> None:
    for split, trains, tests, name in (
        ("test", ("One",), ("Two", "Three"), "tiny-1, split train"),
        ("K1", ("Three",), ("One", "Two"), "tiny-1, all but K1"),
        ("Two", ("One", "Three"), ("Two",), "tiny-1, all but Two"),
    ):
        store = Guarded(tiny_store.path, *tests)
        with pytest.raises(AssertionError, match="read Two"):
            store.read(store.pairs("Two")[0])
        fit = fit_method(store, load_for(store, mean, {}), split, 0)
        assert fit is not None
        assert fit.fitted_on == name
        assert fit.learned is not None
        assert list(fit.learned) == ["level"]
        assert fit.learned["level"] == pytest.approx(mean_of(tiny_store, *trains))
        named, pairs = training_pairs(store, split)
        assert named == name
        expected = [pair.scene for scene in trains for pair in store.pairs(scene)]
        assert [pair.scene for pair in pairs.pairs] == expected


def test_a_fit_cannot_change_the_pairs_and_its_time_is_recorded_apart(
    tiny_store: Dataset, run: Run, tmp_path: Path
) -> None:
    before = [tiny_store.read(pair) for pair in tiny_store.pairs("all")]
    result = run().result
    after = [tiny_store.read(pair) for pair in tiny_store.pairs("all")]
    for one, other in zip(before, after, strict=True):
        for name in ("images", "levels", "valid"):
            assert np.array_equal(getattr(one, name), getattr(other, name))
    assert result.method.fitted_on == "tiny-1, split train"
    assert result.method.fit_seconds is not None
    assert load_result(tmp_path / "out") == result
    depth = np.full(tiny_store.shape_of("Two"), mean_of(tiny_store, "One"), np.float32)
    assert result.pairs[0].prediction_sha256 == array_digest("depth", ("y", "x"), depth)


def test_a_resumed_run_is_not_fitted_again(tiny_store: Dataset, mean: str, tmp_path: Path) -> None:
    fits = []
    for options in (RunOptions(limit=2), RunOptions(), RunOptions(fresh=True), RunOptions(seed=1)):
        method = load_for(tiny_store, mean, {})
        run = run_method(tiny_store, method, "test", tmp_path / "out", options)
        fits.append((type(method.predict).fits, run.reused, run.result.method.fit_seconds))  # type: ignore[attr-defined]
    # Each load imports the file anew, so that each counts its own.
    assert [count for count, _, _ in fits] == [1, 0, 1, 1]
    assert [reused for _, reused, _ in fits] == [0, 2, 0, 0]
    assert fits[0][2] == fits[1][2]


def test_a_fit_that_keeps_it_in_itself_is_called_again_and_stays_in_its_process(
    tiny_store: Dataset, mean: str, run: Run, tmp_path: Path
) -> None:
    for reused in (0, 7):
        method = load_for(tiny_store, mean, {"keep": False})
        done = run_method(tiny_store, method, "test", tmp_path / "out")
        assert (type(method.predict).fits, done.reused) == (1, reused)  # type: ignore[attr-defined]
    assert not (tmp_path / "out" / FIT).exists()
    with pytest.raises(MethodError, match=r"other processes[\s\S]*leave out --workers"):
        run("two", keep=False, pool=Processes(2))
    assert not (tmp_path / "two").exists()


@pytest.mark.slow
def test_workers_are_given_what_was_learned(run: Run) -> None:
    alone, together = run("alone").result, run("together", pool=Processes(2)).result
    assert together.complete
    assert [pair.scores for pair in together.pairs] == [pair.scores for pair in alone.pairs]


def test_a_fit_that_fails_leaves_no_run_behind_and_an_earlier_one_alone(
    tiny_store: Dataset, mean: str, run: Run, tmp_path: Path
) -> None:
    run("runs/out")
    wrong = load_for(tiny_store, mean, {"wrong": True})
    for name in ("out", "new"):
        with pytest.raises(MethodError, match="RuntimeError: too dark"):
            run_method(tiny_store, wrong, "test", tmp_path / "runs" / name)
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["out"]
    assert load_result(tmp_path / "runs/out").complete


def test_damaged_learning_is_not_trusted(run: Run, tmp_path: Path) -> None:
    run()
    assert read_fit(tmp_path / "out").fitted_on == "tiny-1, split train"
    (tmp_path / "out" / FIT).write_bytes(b"PK\x03\x04 rot")
    with pytest.raises(ResultError, match=r"cannot be read[\s\S]*--fresh"):
        run()
    run(fresh=True)


def test_nothing_is_tested_on_what_it_was_fitted_on(run: Run, tmp_path: Path) -> None:
    for split in ("all", "train"):
        with pytest.raises(MethodError, match=r"fitted on[\s\S]*One[\s\S]*test, K1, K2"):
            run(split=split)
        assert not (tmp_path / "out").exists()


def test_a_set_without_training_says_so(tiny_folder: Path, tmp_path: Path, mean: str) -> None:
    text = TINY_TOML.replace('name = "train"', 'name = "learn"')
    store = store_of(text, tiny_folder, tmp_path / "s.zarr")
    with pytest.raises(StoreError, match=r"no split train[\s\S]*--split NAME"):
        run_method(store, load_for(store, mean, {}), "test", tmp_path / "out")
    assert fit_method(store, load_for(store, mean, {}), "K2", 0) is not None


class Stopped:
    """Is being fitted when the user has had enough."""

    def fit(self, pairs: Any) -> Any:
        raise KeyboardInterrupt

    def __call__(self, infocus: Any, defocus: Any) -> Any:
        return infocus[..., 0]


def test_ctrl_c_in_a_fit_does_not_promise_to_go_on_from_there(
    tiny_store: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    method = Method("mine", "tests:Stopped", Stopped())
    with pytest.raises(typer.Exit) as ended, progress("running mine"):
        run_method(tiny_store, method, "test", tmp_path / "out")
    assert ended.value.exit_code == 130
    said = capsys.readouterr().err
    assert "stopped; mine was being fitted: the same command begins the fit anew" in said
    assert "goes on" not in said


def test_one_run_s_fit_is_used_in_another(tiny_store: Dataset, run: Run, tmp_path: Path) -> None:
    run("two", "Two")
    done = run("b", fitted=tmp_path / "two")
    assert done.result.method.fitted_on == "tiny-1, all but Two"
    depth = np.full(tiny_store.shape_of("Two"), mean_of(tiny_store, "One", "Three"), np.float32)
    first = done.result.pairs[0]
    assert first.scene == "Two"
    assert first.prediction_sha256 == array_digest("depth", ("y", "x"), depth)
    # The same run with a fit of its own is another run.
    assert run("b").result.method.fitted_on == "tiny-1, split train"
    (tmp_path / "none").mkdir()
    with pytest.raises(MethodError, match="kept nothing"):
        run("c", fitted=tmp_path / "none")
    result = tmp_path / "two/result.json"
    result.write_text(result.read_text().replace(':Mean"', ':Other"'))
    with pytest.raises(MethodError, match=r"this run is of .*:Other, not of"):
        run("d", fitted=tmp_path / "two")


def test_another_camera_in_the_test_is_told() -> None:
    random, recipe = np.random.default_rng(5), RECIPES["published"]

    def pair(noise: float) -> Capture:
        image = random.integers(0, 256, (90, 120, 3)).astype(np.uint8)
        depth = np.full((90, 120), random.integers(40, 220), np.uint8)
        noisy = synthesize(image, depth, recipe) + noise * random.normal(size=image.shape)
        blurred = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        return made_pair(image, blurred, depth, depth > 0)

    law = BlurLaw(tuple(recipe.sigmas.tolist()), noise=(2.0,) * GREYS)
    quiet, loud = [pair(2) for _ in range(4)], [pair(6) for _ in range(4)]
    assert camera_note(law, quiet, quiet[::-1]) is None
    # Three times the noise, of which black and white cut off a little.
    assert "2.8 times worse than the training's" in str(camera_note(law, loud, quiet))
    assert "2.8 times better" in str(camera_note(law, quiet, loud))
    assert [camera_note(law, pairs) is None for pairs in (quiet, loud)] == [True, False]
    # Of stacks nothing is told.
    grey = np.full((40, 50, 3), 90, np.uint8)
    stack = made_pair(grey, grey, grey[..., 0], np.ones((40, 50), bool), planes=3)
    assert camera_note(law, [stack], [stack]) is None


def test_a_result_says_what_the_fit_chose(demo_store: Dataset, tmp_path: Path) -> None:
    method = load_for(demo_store, "wls", {}, 0)
    result = run_method(demo_store, method, "Market", tmp_path / "run", RunOptions(limit=1)).result
    assert result.method.chosen == method.attribute("chosen").as_dict()
    assert result.method.chosen["strength"] > 0
