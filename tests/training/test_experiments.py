from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, UnknownNameError
from dfdbench.training.experiments import (
    Trial,
    experiment_table,
    experiments,
    find_experiment,
    run_trial,
    trials,
)
from tests.methods.made_weights import card
from tests.methods.networks.test_architectures import SMALL

QUICK: dict[str, Any] = {"filters": list(SMALL), "crop": 16, "crops_per_step": 1, "steps": 2}


def planned(
    name: str, store: Dataset, folder: Path, changes: Mapping[str, Any] = {}, **more: Any
) -> list[Trial]:
    asked = find_experiment(name)
    return trials(asked, "dfd-net", store, "published", {**QUICK, **changes}, folder, **more)


def test_the_thesis_experiments_are_there() -> None:
    known = experiments()
    assert known["repeatability"].repeats == 30
    steps = {int(pair.removeprefix("135-")) for pair in known["sharpest-step"].values}
    assert steps == set(range(127, 144)) - {135}
    assert len(known["voltage-pairs"].values) == 9
    assert known["noise"].repeats == known["sampling-size"].repeats == 10


def test_each_value_and_seed_is_a_training(tiny_store: Dataset, tmp_path: Path) -> None:
    found = planned("noise", tiny_store, tmp_path, values=(0, 2), repeats=3)
    names = [f"{value}-seed{seed}" for value in (0, 2) for seed in range(3)]
    assert [trial.folder.name for trial in found] == names
    assert [trial.task.configuration.noise for trial in found] == [0, 0, 0, 2, 2, 2]
    folds = planned("cross-validation", tiny_store, tmp_path)
    trained_on = [trial.task.trained_on for trial in folds]
    assert trained_on == ["tiny-1, all but K1", "tiny-1, all but K2"]
    # Both expansions get as many examples a step.
    both = planned("expansion", tiny_store, tmp_path, {"crops_per_step": 3})
    choices = [trial.task.configuration for trial in both]
    assert [(one.expansion, one.crops_per_step) for one in choices] == [("basic", 24), ("eight", 3)]


def test_wrong_values_are_told_before_a_training(tiny_store: Dataset, tmp_path: Path) -> None:
    for name, values, kind, told in (
        ("noise", (1, -3), InputError, "noise"),
        ("repeatability", (1,), InputError, "varies the seed alone"),
        ("patch-size", None, InputError, "varies crop itself"),
        ("cross-validation", ("K9",), UnknownNameError, "K1 or K2"),
    ):
        with pytest.raises(kind, match=told):
            planned(name, tiny_store, tmp_path, values=values)


def test_a_training_that_has_ended_is_taken_over(tiny_store: Dataset, tmp_path: Path) -> None:
    def one(**changes: Any) -> Trial:
        return planned("repeatability", tiny_store, tmp_path, changes, repeats=1)[0]

    steps: list[int] = []
    # Time that was too short is given more.
    assert [run_trial(one(), 1e-9, "cpu").steps for _ in "ab"] == [1, 1]
    first = run_trial(one(), None, "cpu", lambda step, total: steps.append(step))
    again = run_trial(one(), None, "cpu", lambda step, total: steps.append(step))
    assert steps == [2]
    assert again == first
    (one().folder / "weights.safetensors").write_bytes(b"damaged")
    (one().folder / "losses.csv").unlink()
    assert run_trial(one(), None, "cpu") == first
    assert (one().folder / "losses.csv").exists()
    with pytest.raises(InputError, match="another training"):
        run_trial(one(noise=1), None, "cpu")


def test_the_table_has_the_statistics_of_table_5_6() -> None:
    scores = [{"nrmse": value, "nmae": value / 2, "ssim": 1 - value} for value in (0.1, 0.2, 0.3)]
    cards = [("", card(seed=seed, scores=found)) for seed, found in enumerate(scores)]
    table = experiment_table(find_experiment("repeatability"), cards)
    rows = {str(record["statistic"]): record for record in table.records}
    assert list(rows) == ["minimum", "mean", "maximum", "std deviation"]
    assert rows["mean"]["nrmse"] == pytest.approx(0.2)
    assert rows["minimum"]["ssim"] == pytest.approx(0.7)
    assert rows["std deviation"]["nmae"] == pytest.approx(0.05)  # of a sample, as in the thesis
    single = experiment_table(find_experiment("cross-validation"), [("K1", cards[0][1])])
    assert [row[0] for row in single.rows] == ["K1"]


def test_trainings_are_known_again_by_their_weights(tiny_store: Dataset, tmp_path: Path) -> None:
    def one(folder: str, start: Path | None) -> Trial:
        place, which = tmp_path / folder, {"values": ("K1",), "start": start}
        # A precision that the processor chooses is known again, too.
        return planned("cross-validation", tiny_store, place, {"precision": "auto"}, **which)[0]

    first = one("first", None)
    run_trial(first, None, "cpu")
    weights = first.folder / "weights.safetensors"
    second = one("second", weights)
    begun = run_trial(second, None, "cpu")
    assert begun.started_from
    assert run_trial(second, None, "cpu") == begun
    # A training that began later in the line is not one that began with the first weights.
    third = one("third", second.folder / "weights.safetensors")
    run_trial(third, None, "cpu")
    for other in (one("second", None), one("first", weights), one("third", weights)):
        with pytest.raises(InputError, match="another training"):
            run_trial(other, None, "cpu")
