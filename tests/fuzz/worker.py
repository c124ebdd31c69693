"""Try inputs one by one in a process of its own, which a hang or a want of memory may end."""

import contextlib
import io
import json
import os
import re
import shutil
import sys
import tempfile
import traceback
from collections.abc import Iterator
from pathlib import Path

import pytest

from dfdbench.errors import DfdbenchError
from tests.fuzz.bench import ITEMS, Bench
from tests.fuzz.guard import LIBRARIES, Guard
from tests.fuzz.inputs import ARGUMENTS, Given, is_reader, make, read

#: Verbs that answer with status 1: no, or a pair failed.
_ANSWER_NO = {"audit", "verify", "run", "tracks", "check-method", "score"}
#: What `write_whole` writes before it has all, and what holds a place.
_LEFTOVER = re.compile(r"\..+\.[a-z0-9_]{8}|\..+\.lock")
_MOST_TEXT = 100_000


def call(folder: Path, arguments: list[str]) -> tuple[int, str]:
    """Call the command line in a folder; return its status and what it printed.

    Raises
    ------
    Exception
        What reaches the user as a traceback.
    """
    from dfdbench.cli import main

    texts = [io.BytesIO(), io.BytesIO()]
    # As main() makes those of a terminal.
    streams = [
        io.TextIOWrapper(text, "utf-8", "backslashreplace", write_through=True) for text in texts
    ]
    status = 0
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sys, "argv", ["dfdbench", *arguments])
        patch.setattr(sys, "path", [str(folder), *sys.path])
        patch.setattr(sys, "stdout", streams[0])
        patch.setattr(sys, "stderr", streams[1])
        try:
            main()
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    for stream in streams:
        stream.detach()
    return status, "".join(text.getvalue().decode("utf-8", "replace") for text in texts)


class Tester:
    """Tries inputs, each in a folder of its own.

    Parameters
    ----------
    place : Path
        Where the sound files and the inputs' folders are.
    guard : Guard
        Watches what they do.
    """

    def __init__(self, place: Path, guard: Guard) -> None:
        self.bench = Bench(place / "bench", call)
        self._place, self._guard = place, guard

    def fault(self, given: Given, sound: bool = False) -> str:
        """Try an input; return what is wrong with what came of it, nothing where all is well.

        A sound one has as long as it takes, and has to succeed.
        """
        folder = self._place / "work"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        self._lay_out(given, folder)
        before = _files(folder)
        wrong: list[str] = []
        with _environment(folder):
            self._guard.begin(folder, limited=not sound)
            try:
                wrong += _tried(given, folder, sound)
            except DfdbenchError as error:
                wrong += [f"a sound input is refused: {error}"] if sound else _ill_told(error)
            except BaseException as error:
                wrong.append(_told(error))
            finally:
                refused = self._guard.end()
        if given.kind != ARGUMENTS:
            # What a user names with an option may lie anywhere.
            wrong += [f"writes outside its folder: {text}" for text in refused[:1]]
        wrong += _left_behind(folder, before, {Path(name).name for name in given.files})
        return "\n".join(wrong)

    def _lay_out(self, given: Given, folder: Path) -> None:
        words = [*given.call, *given.files]
        for name in ITEMS:
            if any(name in re.split(r"[/=:]", word) or name == word for word in words):
                self.bench.copy(name, folder)
        for name, content in given.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)


def _tried(given: Given, folder: Path, sound: bool) -> Iterator[str]:
    if is_reader(given.call):
        read(given.call, folder)
        return
    status, text = call(folder, list(given.call))
    if status == 2 and sound:
        yield f"a sound input is refused: {text[-500:]}"
    if status not in (0, 2) and (status != 1 or given.call[0] not in _ANSWER_NO):
        yield f"status {status}: {text[-300:]}"
    if "Traceback (most recent call last)" in text:
        yield f"a traceback is printed: {text[-2000:]}"
    if status == 2 and not re.search(r"^(error|Error|Usage)", text, re.M):
        yield f"status 2 without a word: {text[-300:]}"
    if len(text) > _MOST_TEXT and status == 2:
        yield f"a message of {len(text)} characters: {text[:200]}"


def _ill_told(error: DfdbenchError) -> Iterator[str]:
    if not error.problems or not all(problem.what for problem in error.problems):
        yield f"an error that says nothing: {error!r}"
    if len(str(error)) > _MOST_TEXT:
        yield f"a message of {len(str(error))} characters"


def _told(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "/dfdbench/" in frame.filename]
    place = "outside"
    if ours:
        name = ours[-1].filename.rpartition("/dfdbench/")[2]
        place = f"{name}:{ours[-1].name}"
    lines = "".join(traceback.format_exception(error))[-3000:]
    return f"{type(error).__name__} in {place}\n{lines}"


def _files(folder: Path) -> set[Path]:
    return set(folder.rglob("*"))


def _left_behind(folder: Path, before: set[Path], spoiled: set[str]) -> Iterator[str]:
    for path in sorted(_files(folder) - before):
        if _LEFTOVER.fullmatch(path.name):
            yield f"left behind: {path.relative_to(folder)}"
        elif path.suffix == ".json" and path.is_file() and path.name not in spoiled:
            try:
                json.loads(path.read_bytes())
            except ValueError:
                yield f"half written: {path.relative_to(folder)}"


@contextlib.contextmanager
def _environment(folder: Path) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DFDBENCH_CACHE", str(folder / "cache"))
        patch.setenv("TMPDIR", str(folder))
        patch.setenv("COLUMNS", "100")
        # Python looks up the place of temporary files once, which may have been before.
        patch.setattr(tempfile, "tempdir", str(folder))
        patch.chdir(folder)
        yield


def main() -> None:
    """Answer requests, a line of JSON each, until there are no more."""
    # What is printed by libraries must not mix with the answers.
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, 1)
    requests = os.fdopen(os.dup(0), "r")
    os.dup2(nowhere, 0)
    place = Path(sys.argv[1])
    os.environ.update(dict.fromkeys(LIBRARIES, str(place.resolve() / "libraries")))
    tester = Tester(place, Guard())
    for line in requests:
        asked = json.loads(line)
        if "kept" in asked:
            given, sound = Given.from_json(asked["kept"]), False
        else:
            given = make(asked["name"], asked["seed"], asked["number"], tester.bench)
            sound = asked["number"] <= 0
        answer = given.as_json() if asked.get("show") else tester.fault(given, sound)
        answers.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    main()
