"""Download files into a folder, several at once; check each, and set bad ones aside."""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

import requests
from requests.adapters import HTTPAdapter
from urllib3.util import Retry

from dfdbench.errors import Problem, SourceError, reason_of, room_or
from dfdbench.system.text import parse_json
from dfdbench.tables.table import counted

#: Files fetched at once: the sites are universities' own, not content networks.
CONNECTIONS = 4
SET_ASIDE = "set-aside"
_BLOCK = 64 * 1024
_TRY_AGAIN = (408, 425, 429, *range(500, 600))
_NOT_THERE = (403, 404, 410)
_FAILURES_TO_GIVE_UP = 3
_CONNECTION = re.compile(r"^<?\w*Connection\w*[(]?[^:]*: ")
_LATER = "try again later: what has come is kept; or name a --mirror URL"

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


def mirrors_lacking(fates: Sequence[Fate], mirrors: Sequence[str]) -> tuple[Problem, ...]:
    """Return a problem for each mirror that was asked for files that it does not have."""
    answers = [answer for fate in fates for answer in fate.lacking]
    by_mirror = {m: [a for a in answers if f" {m.rstrip('/')}/" in a] for m in mirrors}
    return tuple(
        Problem(
            f"the mirror lacks {counted(len(found), 'file')}, such as {found[0]}",
            where=mirror,
            fix="name the address that takes the place of the site's .../stereo/data",
        )
        for mirror, found in by_mirror.items()
        if found
    )


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


@dataclass(frozen=True)
class Patience:
    """How long to wait for a server, and how often to ask again.

    Parameters
    ----------
    tries : int
        Requests for one file at one address before it is given up, and how often one that breaks
        off is resumed.
    pause : float
        Seconds before the third request; doubled before each further one.
    silence : float
        Seconds without a byte after which a connection counts as lost.
    """

    tries: int = 6
    pause: float = 0.5
    silence: float = 30.0


class NotThereError(Exception):
    """The server has no such file; the text is the status that it answers with."""


class UnreachableError(Exception):
    """The file may be there but could not be fetched; `problem` says why."""

    def __init__(self, what: str, where: str, got: str, fix: str = _LATER) -> None:
        self.problem = Problem(what, where=where, got=got, fix=fix)
        super().__init__(str(self.problem))


class _BrokenOffError(Exception):
    """The file came in part; the next request asks for the rest."""


class Transfer:
    """Download single files; several threads share one object.

    Proxies and certificate bundles are taken from the environment: ``HTTPS_PROXY``,
    ``NO_PROXY``, ``REQUESTS_CA_BUNDLE``.

    Parameters
    ----------
    patience : Patience
        With slow and failing servers.
    stopped : threading.Event
        Once set, transfers end where they are.
    on_bytes : callable
        Called with the number of bytes just received, from several threads.
    """

    def __init__(
        self, patience: Patience, stopped: threading.Event, on_bytes: Callable[[int], None]
    ) -> None:
        self._patience = patience
        self._stopped = stopped
        self._on_bytes = on_bytes
        self._failures: Counter[str] = Counter()
        # A certificate that is refused once (`other`) will be refused again.
        retry = Retry(
            patience.tries - 1,
            other=0,
            status_forcelist=_TRY_AGAIN,
            backoff_factor=patience.pause,
            # A server may ask for hours.
            respect_retry_after_header=False,
        )
        self._session = requests.Session()
        for scheme in ("http://", "https://"):
            self._session.mount(scheme, HTTPAdapter(max_retries=retry))
        self._session.headers["User-Agent"] = f"dfdbench/{version('dfdbench')}"
        # Sizes are compared with what the server states: nothing may come compressed.
        self._session.headers["Accept-Encoding"] = "identity"

    def receive(self, address: str, part: Path) -> None:
        """Download what an address holds into a partial file.

        Parameters
        ----------
        address : str
            The file's URL.
        part : Path
            Where its bytes go. What is there from the same version of the file at the same
            address is kept, and only the rest asked for.

        Raises
        ------
        NotThereError
            If the server has no such file.
        UnreachableError
            If it could not be fetched in as many tries as there is patience for, or if that
            happened with several files of the same server already.
        SourceError
            If the disk does not take it.
        """
        try:
            host = urlsplit(address).netloc
        except ValueError as error:
            raise _unreachable(address, requests.exceptions.InvalidURL(error)) from error
        if self._failures[host] >= _FAILURES_TO_GIVE_UP:
            got = f"{self._failures[host]} files in a row could not be fetched from it"
            raise UnreachableError("the server was given up", address, got)
        try:
            self._receive(address, part)
        except UnreachableError:
            self._failures[host] += 1
            raise
        except OSError as error:
            fix = room_or("choose another place with --cache DIR", error)
            got = reason_of(error)
            raise SourceError(
                "cannot keep the download", where=str(part), got=got, fix=fix
            ) from error
        self._failures[host] = 0

    def _receive(self, address: str, part: Path) -> None:
        part.parent.mkdir(parents=True, exist_ok=True)
        reason = "stopped"
        for _ in range(self._patience.tries):
            if self._stopped.is_set():
                break
            try:
                return self._request(address, part)
            except _BrokenOffError as error:
                reason = str(error)
        raise UnreachableError("the server does not send the file", address, reason)

    def _request(self, address: str, part: Path) -> None:
        mark = part.with_name(part.name + ".json")
        have = part.stat().st_size if part.exists() else 0
        headers = _range_of(address, have, mark)
        silence = self._patience.silence
        try:
            answer = self._session.get(address, headers=headers, stream=True, timeout=silence)
        except requests.exceptions.RequestException as error:
            raise _unreachable(address, error) from error
        with answer:
            status = f"{answer.status_code} {answer.reason}"
            if answer.status_code == 416:
                mark.unlink(missing_ok=True)
                raise _BrokenOffError(status)
            if answer.status_code in _NOT_THERE:
                raise NotThereError(str(answer.status_code))
            if answer.status_code >= 400:
                raise UnreachableError("the server refuses", address, status, fix="")
            mark.write_text(json.dumps({"address": address, "validator": _validator(answer)}))
            with part.open("ab" if answer.status_code == 206 else "wb") as out:
                try:
                    for block in answer.iter_content(_BLOCK):
                        if self._stopped.is_set():
                            raise _BrokenOffError("stopped")
                        out.write(block)
                        self._on_bytes(len(block))
                except requests.exceptions.RequestException as error:
                    raise _BrokenOffError(_short(error)) from error
        mark.unlink()


def _range_of(address: str, have: int, mark: Path) -> dict[str, str]:
    try:
        known = parse_json(mark.read_bytes()) if have else {}
    except (OSError, ValueError):
        known = {}
    if known.get("address") != address or not known.get("validator"):
        return {}
    return {"Range": f"bytes={have}-", "If-Range": known["validator"]}


def _validator(answer: requests.Response) -> str:
    tag = answer.headers.get("ETag", "")
    # A weak tag does not promise the same bytes.
    return tag if tag and not tag.startswith("W/") else answer.headers.get("Last-Modified", "")


def _unreachable(address: str, error: requests.exceptions.RequestException) -> UnreachableError:
    what, fix = "the server does not send the file", _LATER
    if isinstance(error, requests.exceptions.SSLError):
        what = f"the certificate of {urlsplit(address).hostname} cannot be verified"
        fix = (
            "its server may leave out an intermediate certificate: save that one and your system's "
            "bundle into one PEM file and set REQUESTS_CA_BUNDLE=FILE; or use --mirror URL, or "
            "fetch the files otherwise and use --source DIR"
        )
    elif isinstance(error, requests.exceptions.ProxyError):
        what, fix = "the proxy refuses", "check HTTPS_PROXY, HTTP_PROXY and NO_PROXY"
    # InvalidURL, InvalidSchema and MissingSchema.
    elif isinstance(error, ValueError):
        what, fix = "not an address", "write it as https://HOST/FOLDER"
    return UnreachableError(what, address, _short(error), fix)


def _short(error: Any) -> str:
    # The reason lies at the bottom of what urllib3 wraps in its pools and retries.
    cause = error
    while cause.args and isinstance(getattr(cause.args[0], "reason", cause.args[0]), Exception):
        cause = getattr(cause.args[0], "reason", cause.args[0])
    text = _CONNECTION.sub("", str(cause))
    return f"{type(cause).__name__}: {text}"[:300]
