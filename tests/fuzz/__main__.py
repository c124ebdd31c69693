"""Try as many inputs as time allows, keep those that go wrong: ``python -m tests.fuzz``.

Each class of inputs gets the same share of the time, or with ``--inputs`` the same number of turns.
An input follows from the seed, its class and its number: the same seed tries the same inputs,
however many of them there is time for.
"""

import argparse
import collections
import contextlib
import hashlib
import itertools
import json
import random
import re
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.fuzz.inputs import ARGUMENTS, NAMES, Given, sound_inputs

FOUND = Path(__file__).parent / "found"
#: Of a clock on the wall: what waits, and computes nothing, hangs as well.
_WALL_SECONDS = 300
#: After so many a fresh process takes over, so that none of them grows.
_INPUTS_A_PROCESS = 2000


class Worker:
    """The process that tries inputs; begun anew where one of them has ended it.

    Parameters
    ----------
    place : Path
        Where it keeps its files.
    """

    def __init__(self, place: Path) -> None:
        self._place = place
        self._last_words = place / "last-words.txt"
        self._process: subprocess.Popen[str] | None = None
        self._tried = 0

    def ask(self, request: dict[str, Any], wait: float = _WALL_SECONDS) -> str:
        """Have an input tried; return what is wrong, nothing where all is well."""
        if self._tried >= _INPUTS_A_PROCESS:
            self.end()
        if self._process is None:
            self._tried = 0
            with self._last_words.open("w") as words:
                command: list[str | Path] = [sys.executable, "-m", "tests.fuzz.worker", self._place]
                pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
                pipes |= {"stderr": words, "cwd": Path(__file__).parents[2]}
                self._process = subprocess.Popen(command, text=True, **pipes)
        process = self._process
        assert process.stdin
        assert process.stdout
        self._tried += 1
        process.stdin.write(json.dumps(request) + "\n")
        process.stdin.flush()
        ready, _, _ = select.select([process.stdout], [], [], wait)
        answer = process.stdout.readline() if ready else ""
        if answer:
            return str(json.loads(answer))
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(10 if ready else 0)
        self.end()
        if not ready:
            return f"hangs: {wait:.0f} seconds passed"
        told = self._last_words.read_text("utf-8", "replace")
        frame = re.search(r'/dfdbench/(\S+\.py)", line \d+ in (\w+)', told)
        place = f" in {frame[1]}:{frame[2]}" if frame else ""
        what = "hangs: 10 seconds of the processor" if process.returncode == -24 else "ends Python"
        return f"{what}{place}, status {process.returncode}\n{told[-2000:]}"

    def end(self) -> None:
        """End the process."""
        if self._process:
            self._process.kill()
            self._process.wait()
            self._process = None


def signature_of(fault: str) -> str:
    """Return what two inputs that find the same defect have in common."""
    return re.sub(r"\d+|'[^']*'", "", fault.partition("\n")[0])[:150]


def main() -> None:
    """Try inputs; end with status 1 where one went wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("--seconds", type=float, default=90)
    parser.add_argument("--inputs", type=int, help="so many of each class, whatever time it takes")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--only", choices=NAMES, action="append", metavar="CLASS")
    parser.add_argument("--keep", type=Path, default=FOUND, help="where failing inputs are kept")
    asked = parser.parse_args()
    print(f"seed {asked.seed}: the same inputs again with --seed {asked.seed}", flush=True)
    with tempfile.TemporaryDirectory(prefix="dfdbench-fuzz-") as place:
        worker = Worker(Path(place))
        try:
            found = _try_all(worker, asked)
        finally:
            worker.end()
    sys.exit(1 if found else 0)


def _try_all(worker: Worker, asked: argparse.Namespace) -> int:
    names = tuple(asked.only or NAMES)
    counts: collections.Counter[str] = collections.Counter()
    spent = dict.fromkeys(names, 0.0)
    known: collections.Counter[str] = collections.Counter()
    # The sound inputs make the sound files and compile what is compiled: their time is not counted.
    numbers = collections.Counter(names)
    for name in names:
        for number in sound_inputs(name) if name == ARGUMENTS else (0,):
            fault = worker.ask({"name": name, "seed": asked.seed, "number": number}, 600)
            if fault:
                print(f"sound input {number} of class {name} fails: {fault}", flush=True)
                known[f"sound input of {name}"] = 1
    for name in _turns(asked, spent):
        request = {"name": name, "seed": asked.seed, "number": numbers[name]}
        numbers[name] += 1
        begun = time.monotonic()
        fault = worker.ask(request)
        spent[name] += time.monotonic() - begun
        counts[name] += 1
        if fault:
            signature = signature_of(fault)
            known[signature] += 1
            if known[signature] == 1:
                print(f"\n{name}, number {request['number']}: {fault}", flush=True)
                print(f"kept as {_keep(worker, request, signature, asked.keep)}", flush=True)
    print(f"\n{'class':<30}   inputs   seconds")
    for name in names:
        print(f"{name:<30}  {counts[name]:>7,}  {spent[name]:>8.1f}")
    for signature, times in known.items():
        print(f"{times:>5} x {signature}")
    print(f"{len(known)} defects" if known else "no defect")
    return len(known)


def _turns(asked: argparse.Namespace, spent: dict[str, float]) -> Iterator[str]:
    if asked.inputs:
        for name in spent:
            yield from itertools.repeat(name, asked.inputs)
        return
    end = time.monotonic() + asked.seconds
    while time.monotonic() < end:
        yield min(spent, key=lambda each: spent[each])


def _keep(worker: Worker, request: dict[str, Any], signature: str, folder: Path) -> Path:
    given = Given.from_json(worker.ask({**request, "show": True}, 600))
    folder.mkdir(parents=True, exist_ok=True)
    stem = re.sub(r"\W+", "-", given.kind)
    path = folder / f"{stem}-{hashlib.sha256(signature.encode()).hexdigest()[:8]}.json"
    path.write_text(given.as_json(), "utf-8")
    return path


if __name__ == "__main__":
    main()
