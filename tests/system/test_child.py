import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.errors import InputError
from dfdbench.system.child import Child, ChildEndedError
from tests.system.made_child import gone

ROOT = Path(__file__).parents[2]
Start = Callable[..., Child]


@pytest.fixture
def start() -> Iterator[Start]:
    started = []

    def begin(*places: Path, hidden: Sequence[Path] = ()) -> Child:
        path = [str(ROOT), *filter(None, sys.path)]
        started.append(Child("tests.system.made_child", path, places, hidden))
        return started[-1]

    yield begin
    for child in started:
        child.end()


def test_it_has_a_folder_of_its_own_and_of_the_environment_what_threads_need(
    start: Start, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("DFDBENCH_CACHE", str(tmp_path))
    monkeypatch.setenv("SECRET", "token")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setenv("NUMBA_CACHE_DIR", f"{tmp_path}/numba")
    child = start(hidden=[tmp_path])
    told, arrays = child.exchange({"do": "look"}, {"levels": np.arange(3)})
    assert arrays["levels"].tolist() == [0, 1, 2]
    found = told["environment"]
    assert found["OMP_NUM_THREADS"] == "1"
    assert not {"DFDBENCH_CACHE", "SECRET", "NUMBA_CACHE_DIR", "PYTEST_CURRENT_TEST"} & {*found}
    assert found["HOME"] == found["TMPDIR"] == told["folder"]
    assert str(tmp_path) not in str(found)
    assert Path(told["folder"]).is_dir()
    child.end()
    assert child.ended
    assert not Path(told["folder"]).exists()


def test_it_reads_what_it_is_given_and_not_what_is_hidden_in_it(
    start: Start, tmp_path: Path
) -> None:
    (tmp_path / "given").mkdir()
    for name in ("given/code", "given/truth", "elsewhere"):
        (tmp_path / name).write_text(name)
    child = start(tmp_path / "given", hidden=[tmp_path / "given/truth"])
    found = {}
    for name in ("given/code", "given/truth", "elsewhere"):
        told, _ = child.exchange({"do": "read", "place": str(tmp_path / name)}, {})
        found[name] = told["found"]
    if not child.disk_hidden:
        pytest.skip("this system has no Landlock")
    assert found == {"given/code": "given/code", "given/truth": None, "elsewhere": None}


def test_nothing_of_a_strangers_is_imported_before_the_disk_is_hidden(
    start: Start, tmp_path: Path
) -> None:
    beside = tmp_path / "beside"
    (beside / "dfdbench/system").mkdir(parents=True)
    spying = (
        "import os\n"
        f"try: found = os.listdir({str(tmp_path / 'hidden')!r})\n"
        "except OSError: found = []\n"
        "if found: os._exit(7)\n"
    )
    (tmp_path / "hidden").mkdir()
    (tmp_path / "hidden/truth").write_text("truth")
    for name in ("ctypes.py", "runpy.py", "pathlib.py", "sitecustomize.py", "dfdbench/__init__.py"):
        (beside / name).write_text(spying)
    (beside / "mine.py").write_text(
        "import ctypes, dfdbench\ndef main(requests): raise SystemExit(5)"
    )
    child = Child("mine", [str(beside), *filter(None, sys.path)], [beside], [tmp_path / "hidden"])
    with pytest.raises(ChildEndedError, match="status 5"):
        child.exchange({}, {})
    if not child.disk_hidden:
        pytest.skip("this system has no Landlock")


def test_of_what_it_writes_the_beginning_is_shown(
    start: Start, capsys: pytest.CaptureFixture[str]
) -> None:
    child = start()
    told, _ = child.exchange({"do": "shout"}, {})
    assert told == {}
    said = ""
    for _ in range(100):
        said += capsys.readouterr().err
        if len(said.encode()) > 99_000:
            break
        time.sleep(0.1)
    assert said.startswith("\\x1b[2J" + "é" * 40_000)
    assert 99_000 < len(said.encode()) < 101_000


@pytest.mark.parametrize(
    ("do", "told"),
    [("exit", "ended with status 3"), ("kill", r"killed by signal 9, SIGKILL, perhaps for want")],
)
def test_it_is_told_how_it_ended(start: Start, do: str, told: str) -> None:
    child = start()
    with pytest.raises(ChildEndedError, match=told):
        child.exchange({"do": do}, {})
    assert child.ended
    # And once more, of one that is gone.
    with pytest.raises(ChildEndedError):
        child.exchange({}, {})


@pytest.mark.slow
def test_what_it_started_neither_holds_us_up_nor_outlives_it(start: Start, tmp_path: Path) -> None:
    child = start()
    began = time.monotonic()
    with pytest.raises(ChildEndedError, match="status 4"):
        child.exchange({"do": "leave", "note": str(tmp_path / "left")}, {})
    assert time.monotonic() - began < 30
    assert gone(int((tmp_path / "left").read_text()))


@pytest.mark.parametrize(
    "raw", ["0000000000000003" + b"[1]".hex(), "00000000000000027b7d", "ffffffffffffffff"]
)
def test_nonsense_is_refused(start: Start, raw: str) -> None:
    with pytest.raises(ChildEndedError, match="nonsense"):
        start().exchange({"raw": raw}, {})


def test_questions_are_served_and_what_that_raises_ends_it(start: Start) -> None:
    def refusing(_: Any) -> Any:
        raise InputError("no such thing")

    child = start()
    assert child.exchange({"do": "ask"}, {}, lambda asked: ({"got": asked["ask"]}, {}))[0] == {
        "got": "more"
    }
    with pytest.raises(InputError, match="no such thing"):
        child.exchange({"do": "ask"}, {}, refusing)
    assert child.ended
    with pytest.raises(ChildEndedError, match="asks for more"):
        start().exchange({"do": "ask"}, {})
