from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")

from dfdbench.datasets.dataset import Dataset
from dfdbench.methods.networks.choices import FILTERS
from dfdbench.training.configuration import read_configuration
from dfdbench.training.search.course import best_as_toml, course_table, iteration_of, network_table
from dfdbench.training.search.evaluation import Outcome
from dfdbench.training.search.log import Row
from dfdbench.training.search.particle import particle_at, position_of
from dfdbench.training.search.swarm import begun, judged
from tests.training.search.made_searches import small_plan, some_rows


def test_an_iteration_in_numbers(tiny_store: Dataset) -> None:
    plan = small_plan(tiny_store)
    swarm = begun(plan.box, 4, 0)
    same = np.repeat(swarm.positions[1][None], 4, 0)
    same[3, :17] += 1  # a third of one of four differs
    values = np.array([3.0, 1.0, np.inf, 2.0])
    swarm = judged(swarm, values)
    object.__setattr__(swarm, "positions", same)
    found = iteration_of(swarm, values)
    assert (found.number, found.best, found.least, found.mean, found.failed) == (0, 1, 1, 2, 1)
    assert found.alike == pytest.approx(1 - 1 / 12)
    empty = iteration_of(swarm, np.full(4, np.inf))
    assert empty.failed == 4
    assert math.isnan(empty.mean)


def test_tables_say_what_selected_and_what_failed(tiny_store: Dataset) -> None:
    plan = small_plan(tiny_store, split="train", as_thesis=True, particles=3)
    rows = some_rows(plan)
    values = np.array([row.outcome.value for row in rows])
    swarm = judged(begun(plan.box, 3, 0), values)
    table = course_table(plan, [iteration_of(swarm, values)], rows[-1:])
    assert table.rows[0][:5] == ("start", "0.5000", "0.5000", "0.5500", "1")
    assert any("selected on the TEST scenes" in note for note in table.notes)
    assert any(note.startswith("iteration 0, particle 2: diverged") for note in table.notes)


def swarm_s(value: float = 0.5) -> Row:
    scores = {"nrmse": 0.1, "nmae": 0.1, "ssim": 0.7}
    position = position_of(FILTERS["pso"], first_activation="sigmoid", crop=16)
    return Row((4, 2), position, Outcome(value, "", scores, scores, 1234, 2, 0.5))


def test_the_network_found_stands_beside_the_baseline(tiny_store: Dataset) -> None:
    table = network_table(small_plan(tiny_store), swarm_s())
    assert table.rows[0] == ("52", "145", "128", "3 x 3", "yes", "sigmoid")
    assert table.rows[3] == ("42", "238", "256", "2 x 2", "", "")
    assert table.rows[16] == ("5", "135", "128", "3 x 3", "yes", "prelu")
    assert table.notes[0] == "found in iteration 4, particle 2: objective 0.5000"


def test_the_best_is_a_configuration_that_trains_the_same_network(
    tiny_store: Dataset, tmp_path: Path
) -> None:
    plan = small_plan(tiny_store, {"noise": 2.0, "precision": "float32"}, as_thesis=True)
    path = tmp_path / "best.toml"
    path.write_text(best_as_toml(plan, swarm_s()))
    assert path.read_text().splitlines()[1].startswith("# selected on the TEST scenes")
    read = read_configuration(str(path))
    assert read == plan.configuration_of(particle_at(swarm_s().position))
    assert read.architecture("dfd-net")["first_activation"] == "sigmoid"
    assert (read.noise, read.crop, read.narrow, read.steps) == (2.0, 16, 64, 2)
