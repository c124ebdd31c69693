"""Bring many files into a folder, each whole and checked: several at once, bad ones set aside."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dfdbench.building.fetching.transfer import NotThereError, Patience, Transfer, UnreachableError
from dfdbench.errors import Problem, SourceError

#: Files fetched at once: the sites are universities' own, not content networks.
CONNECTIONS = 4
SET_ASIDE = "set-aside"

#: Told of (files done, files in all, bytes received).
Progress = Callable[[int, int, int], None]


@dataclass(frozen=True)
class WantedFile:
    """A file to bring.

    Parameters
    ----------
    name : str
        Its place below the folder.
    addresses : tuple of str
        Where it may be had, the best first.
    check : callable
        Called with (path, where it came from); raises SourceError if the file there is not what
        it should be.
    """

    name: str
    addresses: tuple[str, ...]
    check: Callable[[Path, str], None]


@dataclass(frozen=True)
class Fate:
    """What became of a wanted file.

    Parameters
    ----------
    name : str
        The file.
    kind : str
        ``"new"``: fetched now. ``"kept"``: there from before. ``"missing"``: no address has it.
        ``"unreachable"``: an address may have it, but it could not be had. ``"damaged"``: it
        came and was refused, twice.
    problems : tuple of Problem
        What was wrong with it.
    lacking : tuple of str
        The addresses that were asked and do not have it, each after its status: ``404 https://...``
    """

    name: str
    kind: Literal["new", "kept", "missing", "unreachable", "damaged"]
    problems: tuple[Problem, ...] = ()
    lacking: tuple[str, ...] = ()


def fetch(
    wanted: Sequence[WantedFile],
    folder: Path,
    on_progress: Progress | None = None,
    patience: Patience | None = None,
    offline: bool = False,
) -> tuple[Fate, ...]:
    """Bring files into a folder, each whole and checked or not at all.

    A file that is there and passes its check is kept. One that fails it, there or when it came,
    is moved to the folder ``set-aside`` and fetched once more.

    Parameters
    ----------
    wanted : sequence of WantedFile
        What to bring.
    folder : Path
        Where to.
    on_progress : callable, optional
        Told of files and bytes, by one thread at a time.
    patience : Patience, optional
        With slow and failing servers.
    offline : bool
        Ask nobody: only look at what is there.

    Returns
    -------
    tuple of Fate
        What became of each file, in the order wanted.

    Raises
    ------
    SourceError
        Where the disk does not take them.
    """
    counter = _Counter(len(wanted), on_progress)
    stopped = threading.Event()
    transfer = Transfer(patience or Patience(), stopped, counter.add_bytes)

    def bring(file: WantedFile) -> Fate:
        fate = _bring(file, folder, None if offline else transfer)
        counter.add_file()
        return fate

    pool = ThreadPoolExecutor(CONNECTIONS)
    try:
        futures = [pool.submit(bring, file) for file in wanted]
        for future in as_completed(futures):
            future.result()
        return tuple(future.result() for future in futures)
    finally:
        # After Ctrl-C or a full disk what runs is broken off: its part is gone on with next time.
        stopped.set()
        pool.shutdown(wait=True, cancel_futures=True)


class _Counter:
    def __init__(self, files: int, on_progress: Progress | None) -> None:
        self._lock = threading.Lock()
        self._files = files
        self._on_progress = on_progress
        self._done = 0
        self._received = 0

    def add_file(self) -> None:
        with self._lock:
            self._done += 1
            self._tell()

    def add_bytes(self, count: int) -> None:
        with self._lock:
            self._received += count
            self._tell()

    def _tell(self) -> None:
        if self._on_progress:
            self._on_progress(self._done, self._files, self._received)


def _bring(file: WantedFile, folder: Path, transfer: Transfer | None) -> Fate:
    path = folder / file.name
    refused: tuple[Problem, ...] = ()
    chances = 2
    if path.exists():
        refused = _refusal(file, path, str(path))
        if not refused:
            return Fate(file.name, "kept")
        _set_aside(path, folder, file.name)
        chances = 1
    part = path.with_name(path.name + ".part")
    unreachable: list[Problem] = []
    lacking: list[str] = []
    to_ask = list(file.addresses) if transfer else []
    for address in to_ask:
        assert transfer is not None
        try:
            transfer.receive(address, part)
        except NotThereError as error:
            lacking.append(f"{error} {address}")
            continue
        except UnreachableError as error:
            unreachable.append(error.problem)
            continue
        refused = _refusal(file, part, address)
        if not refused:
            part.replace(path)
            return Fate(file.name, "new", (), tuple(lacking))
        _set_aside(part, folder, file.name)
        chances -= 1
        if not chances:
            break
        # The others first: a server that sent a bad file may well send it again.
        to_ask.append(address)
    if refused:
        return Fate(file.name, "damaged", refused, tuple(lacking))
    if unreachable:
        return Fate(file.name, "unreachable", tuple(unreachable[:1]), tuple(lacking))
    return Fate(file.name, "missing", (), tuple(lacking))


def _refusal(file: WantedFile, path: Path, where: str) -> tuple[Problem, ...]:
    try:
        file.check(path, where)
    except SourceError as error:
        return error.problems
    return ()


def _set_aside(path: Path, folder: Path, name: str) -> None:
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
    place = folder / SET_ASIDE / f"{name}.{digest}"
    place.parent.mkdir(parents=True, exist_ok=True)
    path.replace(place)
