import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.methods.networks.choices import FILTERS
from dfdbench.methods.networks.weights import load_weights
from dfdbench.system.parallel import Cluster, Processes
from dfdbench.training.configuration import read_configuration
from dfdbench.training.search import swarm_search
from dfdbench.training.search.log import Evaluation, LogRow
from dfdbench.training.search.particle import begun, judged, particle_at
from dfdbench.training.search.search_plan import SearchPlan
from tests.conftest import ON_SERVERS
from tests.training.search.made_searches import losses, position_of, small_plan, some_rows

ITERATIONS = 2


def searched(
    store: Dataset, folder: Path, iterations: int = ITERATIONS, **how: Any
) -> swarm_search.SearchOutcome:
    plan = small_plan(store)
    return swarm_search.run_search(plan, folder, iterations, device="cpu", threads=1, **how)


def same(one: swarm_search.SearchOutcome, other: swarm_search.SearchOutcome) -> bool:
    names = ("best_at", "positions", "velocities", "own", "own_values", "best")
    return all(np.array_equal(getattr(one.swarm, n), getattr(other.swarm, n)) for n in names)


@pytest.mark.slow
def test_a_search_leaves_a_log_and_its_best_training(tiny_store: Dataset, tmp_path: Path) -> None:
    said: list[tuple[int, int]] = []
    outcome = searched(tiny_store, tmp_path / "s", 1, on_done=lambda *done: said.append(done))
    assert said == [(done, 4) for done in range(5)]
    assert (outcome.finished, outcome.trainings) == (True, 4)
    assert outcome.best is not None
    assert [item.number for item in outcome.course] == [0, 1]
    rows = (tmp_path / "s/positions.csv").read_text().splitlines()
    assert len(rows) == 5
    objectives = [float(row.split(",")[2]) for row in rows[1:]]
    assert outcome.best.objective == min(objectives) == outcome.course[-1].best
    # The weights of all but the best are gone.
    (kept,) = (tmp_path / "s/particles").iterdir()
    assert kept.name == "{:03}-{:03}".format(*outcome.best.place)
    card = load_weights(kept / "weights.safetensors", "dfd-net")[1]
    assert card.parameters == outcome.best.parameters
    # Asked for more, it goes on; asked for the same again, it trains nothing.
    more = searched(tiny_store, tmp_path / "s")
    assert same(more, searched(tiny_store, tmp_path / "at-once"))
    assert losses(tmp_path / "s") == losses(tmp_path / "at-once")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["processes", pytest.param("cluster", marks=ON_SERVERS)])
def test_elsewhere_it_ends_with_the_same_swarm(
    kind: str, tiny_store: Dataset, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    pool = Processes(2) if kind == "processes" else Cluster(request.getfixturevalue("cluster"))
    here = searched(tiny_store, tmp_path / "here")
    assert same(here, searched(tiny_store, tmp_path / "there", pool=pool))
    assert losses(tmp_path / "here") == losses(tmp_path / "there")


def test_a_failed_training_is_told_and_searched_past(
    tiny_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained = Evaluation.__call__

    def sometimes(self: Evaluation, particle: tuple[Any, Any]) -> LogRow | None:
        if particle[0][1] == 0:
            return LogRow(*particle, failed="diverged: the loss became nan, step 2")
        return trained(self, particle)

    monkeypatch.setattr(Evaluation, "__call__", sometimes)
    outcome = searched(tiny_store, tmp_path / "s")
    assert [row.place for row in outcome.failures] == [(0, 0), (1, 0), (2, 0)]
    assert [item.failed for item in outcome.course] == [1, 1, 1]
    assert outcome.best is not None
    assert outcome.best.place[1] == 1
    assert same(searched(tiny_store, tmp_path / "s"), outcome)

    def never(self: Evaluation, particle: tuple[Any, Any]) -> LogRow:
        return LogRow(*particle, failed="failed: no memory")

    monkeypatch.setattr(Evaluation, "__call__", never)
    nothing = searched(tiny_store, tmp_path / "t")
    assert (nothing.best, nothing.finished) == (None, True)


@pytest.mark.slow
def test_time_is_up_and_more_time_goes_on(
    tiny_store: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    early = searched(tiny_store, tmp_path / "s", max_seconds=0)
    assert (early.finished, early.swarm, early.course, early.trainings) == (False, None, [], 0)
    asked, trained = [], Evaluation.__call__

    def three(self: Evaluation, particle: Any) -> LogRow | None:
        asked.append(particle)
        return trained(self, particle) if len(asked) <= 3 else None

    monkeypatch.setattr(Evaluation, "__call__", three)
    some = searched(tiny_store, tmp_path / "s")
    assert (some.finished, len(some.course), some.trainings) == (False, 1, 3)
    monkeypatch.undo()
    assert same(searched(tiny_store, tmp_path / "s"), searched(tiny_store, tmp_path / "t"))


def test_an_iteration_in_numbers(tiny_store: Dataset) -> None:
    swarm = begun(small_plan(tiny_store).box, 4, 0)
    same = np.repeat(swarm.positions[1][None], 4, 0)
    same[3, :17] += 1  # a third of one of four differs
    values = np.array([3.0, 1.0, np.inf, 2.0])
    swarm = replace(judged(swarm, values), positions=same)
    found = swarm_search.iteration_of(swarm, values)
    assert (found.number, found.best, found.least, found.mean, found.failed) == (0, 1, 1, 2, 1)
    assert found.alike == pytest.approx(1 - 1 / 12)
    empty = swarm_search.iteration_of(swarm, np.full(4, np.inf))
    assert empty.failed == 4
    assert math.isnan(empty.mean)


def swarm_s(plan: SearchPlan) -> LogRow:
    position = position_of(FILTERS["pso"], first_activation="sigmoid", crop=16)
    return replace(some_rows(plan)[0], place=(4, 2), position=position)


def test_the_network_found_stands_beside_the_baseline(tiny_store: Dataset) -> None:
    plan = small_plan(tiny_store)
    table = swarm_search.network_table(plan, swarm_s(plan))
    assert table.rows[0] == ("52", "145", "128", "3 x 3", "yes", "sigmoid")
    assert table.rows[3] == ("42", "238", "256", "2 x 2", "", "")
    assert table.rows[16] == ("5", "135", "128", "3 x 3", "yes", "prelu")
    assert table.notes[0] == "found in iteration 4, particle 2: objective 0.5000"


def test_the_best_is_a_configuration_of_its_network(tiny_store: Dataset, tmp_path: Path) -> None:
    plan = small_plan(tiny_store, {"noise": 2.0, "precision": "float32"}, as_thesis=True)
    path, best = tmp_path / "best.toml", swarm_s(plan)
    path.write_text(swarm_search.best_as_toml(plan, best))
    assert path.read_text().splitlines()[1].startswith("# selected on the TEST scenes")
    read = read_configuration(str(path))
    assert read == plan.configuration_of(particle_at(best.position))
    assert read.architecture("dfd-net")["first_activation"] == "sigmoid"
    assert (read.noise, read.crop, read.narrow, read.steps) == (2.0, 16, 64, 2)
