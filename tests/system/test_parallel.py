from __future__ import annotations

import os
import threading
import time

import pytest

from dfdbench.errors import InputError
from dfdbench.system.parallel import Cluster, Pool, Processes, Threads
from tests.conftest import ON_SERVERS


@pytest.fixture(
    params=["one thread", "three threads", "processes", pytest.param("cluster", marks=ON_SERVERS)]
)
def pool(request: pytest.FixtureRequest) -> Pool:
    if request.param == "cluster":
        return Cluster(request.getfixturevalue("cluster"))
    pools: dict[str, Pool] = {
        "one thread": Threads(1),
        "three threads": Threads(3),
        "processes": Processes(2),
    }
    return pools[request.param]


def square_slowly(item: int) -> int:
    time.sleep(0.02 if item == 0 else 0)
    return item * item


def fail(item: int) -> int:
    raise ValueError(f"no {item}")


def process_of(_: int) -> int:
    time.sleep(0.3)
    return os.getpid()


def test_answers_come_in_the_items_order_and_progress_counts_up(pool: Pool) -> None:
    seen: list[tuple[int, int]] = []
    told: list[object] = []

    def on_outcome(item: int, answer: int) -> None:
        seen.append((item, answer))
        told.append("outcome")

    answers = pool.map(
        square_slowly, range(12), on_outcome, lambda done, total: told.append((done, total))
    )
    assert answers == [item * item for item in range(12)]
    assert sorted(seen) == [(item, item * item) for item in range(12)]
    # One by one, and each after its outcome.
    assert told[::2] == ["outcome"] * 12
    assert told[1::2] == [(done, 12) for done in range(1, 13)]


def test_progress_alone_is_told_too_and_of_nothing_none() -> None:
    told: list[tuple[int, int]] = []
    Threads(2).map(square_slowly, [3, 4], on_done=lambda *done: told.append(done))
    Threads(2).map(square_slowly, [], on_done=lambda *done: told.append(done))
    assert told == [(1, 2), (2, 2)]


def test_what_failed_is_not_told_as_done() -> None:
    told: list[tuple[int, int]] = []
    with pytest.raises(ValueError, match="no 2"):
        Threads(1).map(
            lambda item: fail(item) if item == 2 else item,
            [1, 2, 3],
            on_done=lambda *done: told.append(done),
        )
    assert (2, 3) not in told


def test_errors_come_through(pool: Pool) -> None:
    with pytest.raises(ValueError, match=r"no [12]"):
        pool.map(fail, [1, 2])


def test_nothing_to_do(pool: Pool) -> None:
    assert pool.map(fail, []) == []


def test_threads_work_at_once() -> None:
    barrier = threading.Barrier(2, timeout=10)
    assert len(Threads(2).map(lambda _: barrier.wait(), range(2))) == 2


@pytest.mark.parametrize("kind", ["processes", pytest.param("cluster", marks=ON_SERVERS)])
def test_processes_are_others(kind: str, request: pytest.FixtureRequest) -> None:
    others: Pool = (
        Processes(2) if kind == "processes" else Cluster(request.getfixturevalue("cluster"))
    )
    found = set(others.map(process_of, range(4)))
    assert len(found) == 2
    assert os.getpid() not in found


def test_no_scheduler_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dfdbench.system.parallel._SECONDS_TO_ANSWER", 1)
    with pytest.raises(InputError, match="no scheduler answers") as caught:
        Cluster("tcp://127.0.0.1:9").map(abs, [1])
    assert "tcp://127.0.0.1:9" in str(caught.value)
    with pytest.raises(InputError, match="no scheduler answers"):
        Cluster("nonsense://x").map(abs, [1])
