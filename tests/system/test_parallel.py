import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import dask
import pytest
from distributed import LocalCluster

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError
from dfdbench.system.parallel import Cluster, Pool, Processes, Threads
from tests.conftest import ON_SERVERS
from tests.process import python


@pytest.fixture(
    params=[
        *(Threads(1), Threads(3)),
        pytest.param(Processes(2), marks=pytest.mark.slow),
        pytest.param("cluster", marks=ON_SERVERS),
    ]
)
def pool(request: pytest.FixtureRequest) -> Pool:
    if request.param == "cluster":
        return Cluster(request.getfixturevalue("cluster"))
    pool: Pool = request.param
    return pool


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
    said: list[object] = []

    def on_outcome(item: int, answer: int) -> None:
        seen.append((item, answer))
        said.append("outcome")

    answers = pool.map(
        square_slowly, range(12), on_outcome, lambda done, total: said.append((done, total))
    )
    assert answers == [item * item for item in range(12)]
    assert sorted(seen) == [(item, item * item) for item in range(12)]
    # One by one, and each after its outcome.
    assert (said[::2], said[1::2]) == (["outcome"] * 12, [(done, 12) for done in range(1, 13)])


def test_errors_come_through(pool: Pool) -> None:
    with pytest.raises(ValueError, match=r"no [12]"):
        pool.map(fail, [1, 2])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["processes", pytest.param("cluster", marks=ON_SERVERS)])
def test_processes_are_others(kind: str, request: pytest.FixtureRequest) -> None:
    on_cluster = kind == "cluster"
    others: Pool = Cluster(request.getfixturevalue("cluster")) if on_cluster else Processes(2)
    found = set(others.map(process_of, range(4)))
    assert len(found) == 2
    assert os.getpid() not in found


@pytest.mark.parametrize("address", ["foo", "tcp://node1", "node1:", "http://a:1", ""])
def test_what_is_no_address_is_refused_before_anything_is_asked(address: str) -> None:
    with pytest.raises(InputError, match="not a scheduler's address"):
        Cluster(address).map(str, [1])


def test_no_scheduler_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dfdbench.system.parallel._SECONDS_TO_ANSWER", 1)
    with pytest.raises(InputError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"):
        Cluster("tcp://127.0.0.1:9").map(abs, [1])


def note_and_wait(file: str) -> None:
    Path(file).write_text(str(os.getpid()))
    time.sleep(600)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="asks for a process by its number")
def test_workers_end_with_who_was_killed(tmp_path: Path) -> None:
    program = (
        "from dfdbench.system.parallel import Processes\n"
        "from tests.system.test_parallel import note_and_wait\n"
        "if __name__ == '__main__':\n"
        f"    Processes(1).map(note_and_wait, [{str(tmp_path / 'worker')!r}])\n"
    )
    (tmp_path / "program.py").write_text(program)
    root = Path(__file__).parents[2]
    parent = subprocess.Popen(
        [sys.executable, str(tmp_path / "program.py")], env={**os.environ, "PYTHONPATH": str(root)}
    )
    noted = tmp_path / "worker"
    within(120, lambda: noted.exists() and noted.read_text())
    worker = int(noted.read_text())
    assert is_running(worker)
    parent.kill()
    parent.wait()
    within(60, lambda: not is_running(worker))


def within(seconds: float, what: Callable[[], object]) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end
        time.sleep(0.05)


def is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    # One that has ended and that nobody has asked for is still listed.
    status = Path(f"/proc/{process}/stat")
    return not status.exists() or status.read_text().rpartition(")")[2].split()[0] != "Z"


@ON_SERVERS
def test_a_scheduler_that_goes_away_is_told() -> None:
    said: list[int] = []
    with dask.config.set({"distributed.comm.timeouts.connect": "1s"}):
        cluster = LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
        )
        closing = threading.Thread(target=cluster.close)

        def close(item: int, _: int) -> None:
            said.append(item)
            closing.start()

        with pytest.raises(InputError, match="went away"):
            Cluster(cluster.scheduler_address).map(square_and_wait, range(4), close)
        closing.join()
    # What was done before was said, and what was not was not.
    assert said == [0]


@pytest.mark.slow
@ON_SERVERS
def test_work_that_ends_its_workers_is_told() -> None:
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=1, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        pytest.raises(InputError, match="workers ended without a word"),
    ):
        Cluster(cluster.scheduler_address).map(os._exit, [3])


# Ctrl-C while a result is on its way.
_STOPPED = """
import time
from distributed import LocalCluster
from dfdbench.system.parallel import Cluster

class Slow:
    def __getstate__(self):
        time.sleep(2)
        return {}

def stop(item, _):
    time.sleep(1)
    raise KeyboardInterrupt

if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        try:
            Cluster(cluster.scheduler_address).map(lambda item: Slow() if item else 0, [0, 1], stop)
        except KeyboardInterrupt:
            print("stopped")
"""


@pytest.mark.slow
@ON_SERVERS
def test_a_stop_is_told_by_nobody_else(tmp_path: Path) -> None:
    (tmp_path / "stopped.py").write_text(_STOPPED)
    path = str(Path(__file__).parents[2])
    done = python(tmp_path / "stopped.py", PYTHONPATH=path)
    assert done.stdout == "stopped\n"
    assert "Traceback" not in done.stderr


@ON_SERVERS
def test_a_cluster_without_workers_is_told_and_waited_for() -> None:
    with LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=0, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        later = threading.Timer(1, cluster.scale, [1])
        later.start()
        with pytest.warns(UserWarning, match="no worker is connected"):
            assert Cluster(cluster.scheduler_address).map(abs, [-1]) == [1]
        later.join()


def square_and_wait(item: int) -> int:
    time.sleep(0.2 if item == 0 else 1)
    return item * item


# The garbage collector comes by when it likes: here it is called.
_TWENTY_TIMES = """
import gc, sys, time
from dfdbench.cli import main
for _ in range(20):
    sys.argv = ["dfdbench", "info", sys.argv[-1]]
    try:
        main()
    except SystemExit as ended:
        assert ended.code == 2
    gc.collect()
    time.sleep(0.02)
"""


@pytest.mark.slow
def test_a_store_with_several_damaged_scenes_is_one_error(tiny_store: Dataset) -> None:
    path = tiny_store.path
    first, *others = tiny_store.scenes
    (path / first / "zarr.json").write_text("{")
    for scene in others:
        (path / scene / "zarr.json").unlink()
    done = python("-c", _TWENTY_TIMES, str(path))
    assert done.returncode == 0
    assert "cannot read the store" in done.stderr
    assert "Traceback" not in done.stderr
    assert "Task" not in done.stderr
