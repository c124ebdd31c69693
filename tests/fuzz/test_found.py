"""Inputs that went wrong once, tried again; and the watch that finds such, watched."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fuzz.__main__ import FOUND, Worker
from tests.fuzz.inputs import NAMES, Given, sound_inputs

KEPT = sorted(FOUND.glob("*.json"))


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    worker = Worker(tmp_path_factory.mktemp("fuzz"))
    yield worker
    worker.end()


@pytest.mark.slow
@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_what_was_found_is_told_now(worker: Worker, path: Path) -> None:
    assert worker.ask({"kept": path.read_text("utf-8")}) == ""


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_what_is_sound_succeeds(worker: Worker, name: str) -> None:
    # What is refused from the start would be spoiled in vain.
    for number in sound_inputs(name):
        assert worker.ask({"name": name, "seed": 0, "number": number}, 600) == "", number


_BAD = {
    "import os; os.abort()": "ends Python",
    "while True: pass": "hangs: 10 seconds of the processor",
    "raise KeyError('depth')": "KeyError",
    "open('/dfdbench-outside', 'w')": "writes outside its folder: open /dfdbench-outside",
    "open('result.json', 'w').write('{')": "half written: result.json",
}


@pytest.mark.slow
@pytest.mark.parametrize("code", _BAD)
def test_what_must_not_happen_is_noticed(worker: Worker, code: str) -> None:
    given = Given("PNG", ("[python]", "bad.py"), {"bad.py": code.encode()})
    assert _BAD[code] in worker.ask({"kept": given.as_json()})


def test_an_input_is_kept_as_it_was() -> None:
    given = Given("PNG", ("[png-depth]", "a.png"), {"a.png": b"\x89PNG", "b.toml": b"a = 1"})
    assert Given.from_json(given.as_json()) == given
    assert json.loads(given.as_json())["files"]["b.toml"] == {"text": "a = 1"}
