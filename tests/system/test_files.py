import errno
import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from dfdbench.errors import ResultError, StoreError
from dfdbench.system import files


def test_a_failed_write_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.json"
    files.write_whole(path, "old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        files.write_whole(path, "new")
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.json"]


def kill_while_writing(path: Path) -> None:
    """Let a process begin to write a file, and kill it before the file is whole."""
    program = (
        "import os, pathlib, signal, sys; from dfdbench.system import files;"
        "os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL);"
        "files.write_whole(pathlib.Path(sys.argv[1]), 'half')"
    )
    done = subprocess.run([sys.executable, "-c", program, str(path)], check=False)
    assert done.returncode == -signal.SIGKILL
    assert not path.exists()
    assert len(list(path.parent.iterdir())) == 1


def test_what_a_kill_left_of_a_file_is_none(tmp_path: Path) -> None:
    kill_while_writing(tmp_path / "folder/a.json")
    assert files.whole_files(tmp_path / "folder") == []
    files.write_whole(tmp_path / "folder/a.json", "whole")
    assert files.whole_files(tmp_path / "folder") == [tmp_path / "folder/a.json"]
    assert files.whole_files(tmp_path / "none") == []


def test_a_file_is_read_up_to_a_bound(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"ab\r\ncd")
    assert (files.read_whole(path, 6), files.read_text(path)) == (b"ab\r\ncd", "ab\ncd")
    with pytest.raises(OSError, match="larger than"):
        files.read_whole(path, 5)
    path.write_text("ab", "utf-8-sig")
    assert files.read_text(path) == "ab"


TAKEN = StoreError("taken")


def test_only_one_holds_a_place_and_no_lock_file_stays(tmp_path: Path) -> None:
    lock = tmp_path / ".a.lock"
    with files.hold(lock, TAKEN):
        for _ in range(2):
            with pytest.raises(StoreError, match="taken"), files.hold(lock, TAKEN):
                pass
        assert lock.exists()
    assert not lock.exists()
    with pytest.raises(ValueError, match="mine"), files.hold(lock, TAKEN):
        raise ValueError("mine")
    # A killed process leaves its file.
    lock.touch()
    with files.hold(lock, TAKEN):
        pass
    assert not lock.exists()


def take_turns(folder: str, turns: int) -> None:
    """Hold the place again and again; fails where another is there at the same time."""
    inside = Path(folder, "inside")
    done = 0
    while done < turns:
        try:
            with files.hold(Path(folder, ".a.lock"), TAKEN):
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


def test_a_second_writer_is_told_and_the_first_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folder = tmp_path / "deep" / "run"
    with files.writing_folder(folder, "search"):
        with (
            pytest.raises(ResultError, match="another search is writing this folder"),
            files.writing_folder(folder, "search"),
        ):
            pass
        folder.mkdir()
    with files.writing_folder(folder, "search"):
        pass
    monkeypatch.chdir(folder)
    with files.writing_folder(Path(), "search"):
        assert sorted(path.name for path in folder.parent.iterdir()) == [".run.lock", "run"]
    assert [path.name for path in folder.parent.iterdir()] == ["run"]


def test_what_the_disk_does_not_take_is_told_with_what_to_do(tmp_path: Path) -> None:
    with (
        pytest.raises(ResultError, match=r"cannot write the run(.|\n)*goes on where it stopped"),
        files.writing_folder(tmp_path / "run", "run"),
    ):
        raise OSError(errno.ENOSPC, "No space left on device")
