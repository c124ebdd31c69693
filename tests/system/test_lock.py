from __future__ import annotations

import json
import multiprocessing
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from upath import UPath

from dfdbench.errors import StoreError
from dfdbench.system.location import exists, is_local
from dfdbench.system.lock import hold

TAKEN = StoreError("taken")


def test_only_one_holds_a_place(place: Callable[[str], UPath]) -> None:
    lock = place(".a.lock")
    with hold(lock, TAKEN) as check:
        check()
        with pytest.raises(StoreError, match="taken"), hold(lock, TAKEN):
            pass
        check()
    with hold(lock, TAKEN):
        pass


def test_a_failure_gives_the_place_free(place: Callable[[str], UPath]) -> None:
    lock = place(".a.lock")
    with pytest.raises(ValueError, match="mine"), hold(lock, TAKEN):
        raise ValueError("mine")
    with hold(lock, TAKEN):
        pass


def leave(lock: UPath, host: str, process: int, renewed: float) -> None:
    content = {"owner": "other", "host": host, "process": process, "renewed": renewed}
    lock.write_bytes(json.dumps(content).encode())


def finished_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


@pytest.mark.parametrize(
    ("host", "process", "age", "held"),
    [
        ("here", "finished", 0, False),
        ("here", "this", 999, True),
        ("another", "this", 5, True),
        ("another", "this", 61, False),
    ],
)
def test_what_a_killed_build_left_is_taken_over(
    place: Callable[[str], UPath], host: str, process: str, age: float, held: bool
) -> None:
    lock = place(".a.lock")
    if is_local(lock):
        pytest.skip("on disk the lock ends with its process")
    number = os.getpid() if process == "this" else finished_process()
    leave(lock, socket.gethostname() if host == "here" else host, number, time.time() - age)
    if held:
        with pytest.raises(StoreError, match="taken"), hold(lock, TAKEN):
            pass
        assert json.loads(lock.read_bytes())["owner"] == "other"
    else:
        with hold(lock, TAKEN):
            assert json.loads(lock.read_bytes())["process"] == os.getpid()
        assert not exists(lock)


def _told(lock: UPath) -> dict[str, Any]:
    # In one request: what is opened and then read may have been renewed in between.
    found: dict[str, Any] = json.loads(lock.fs.cat_file(lock.path))
    return found


def test_a_lease_is_renewed_and_its_loss_is_noticed(place: Callable[[str], UPath]) -> None:
    lock = place(".a.lock")
    if is_local(lock):
        pytest.skip("on disk the lock ends with its process")
    with hold(lock, TAKEN, lease=0.4) as check:
        first = _told(lock)["renewed"]
        deadline = time.monotonic() + 10
        while _told(lock)["renewed"] == first and time.monotonic() < deadline:
            time.sleep(0.05)
        assert _told(lock)["renewed"] > first
        leave(lock, "another", 1, time.time())
        with pytest.raises(StoreError, match="taken"):
            check()
    # Another's lock is not removed.
    assert _told(lock)["owner"] == "other"


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that takes no file")
def test_a_folder_that_takes_no_file_is_not_told_as_held_by_another() -> None:
    with pytest.raises(OSError), hold(UPath("/proc/no.lock"), TAKEN):  # noqa: PT011
        pass


def test_no_lock_file_stays(place: Callable[[str], UPath]) -> None:
    lock = place(".a.lock")
    with hold(lock, TAKEN):
        assert exists(lock)
        # Who is refused takes nothing away.
        with pytest.raises(StoreError, match="taken"), hold(lock, TAKEN):
            pass
        assert exists(lock)
    assert not exists(lock)
    with pytest.raises(ValueError, match="mine"), hold(lock, TAKEN):
        raise ValueError("mine")
    assert not exists(lock)


def test_a_file_that_an_earlier_version_left_is_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / ".a.lock").touch()
    with hold(UPath(tmp_path / ".a.lock"), TAKEN):
        pass
    assert list(tmp_path.iterdir()) == []


def take_turns(folder: str, turns: int) -> None:
    """Hold the place again and again; fails where another is there at the same time."""
    inside = Path(folder, "inside")
    done = 0
    while done < turns:
        try:
            with hold(UPath(folder, ".a.lock"), TAKEN):
                os.close(os.open(inside, os.O_CREAT | os.O_EXCL))
                inside.unlink()
                done += 1
        except StoreError:
            os.sched_yield()


def test_processes_that_come_and_go_are_never_in_one_place_together(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=take_turns, args=(str(tmp_path), 300)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert not any(process.exitcode for process in processes)
    assert list(tmp_path.iterdir()) == []


def test_where_the_file_system_has_no_locks_another_kind_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dfdbench.system.lock.fcntl", None)
    lock = UPath(tmp_path / ".a.lock")
    with hold(lock, TAKEN), pytest.raises(StoreError, match="taken"), hold(lock, TAKEN):
        pass
    with hold(lock, TAKEN):
        pass
