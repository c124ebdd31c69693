"""Download files into a folder, several at once; check each, and set bad ones aside."""

from __future__ import annotations

import hashlib
import re
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

import requests
from requests.adapters import HTTPAdapter
from urllib3.util import Retry

from dfdbench.errors import Problem, SourceError, reason_of, room_or
from dfdbench.tables.table import counted

#: Files fetched at once: the sites are universities' own, not content networks.
CONNECTIONS = 4
SET_ASIDE = "set-aside"
_BLOCK = 64 * 1024
_TRY_AGAIN = (408, 425, 429, *range(500, 600))
_NOT_THERE = (403, 404, 410)
_FAILURES_TO_GIVE_UP = 3
_CONNECTION = re.compile(r"^<?\w*Connection\w*[(]?[^:]*: ")
_LATER = "try again later: files that are whole are kept; or name a --mirror URL"

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


@dataclass(frozen=True)
class Patience:
    """How long to wait for a server, and how often to ask again.

    Parameters
    ----------
    tries : int
        Requests for one file at one address before it is given up.
    pause : float
        Seconds before the third request; doubled before each further one.
    silence : float
        Seconds without a byte after which a connection counts as lost.
    """

    tries: int = 6
    pause: float = 0.5
    silence: float = 30.0


class Fetcher:
    """Bring files into a folder, each whole and checked or not at all.

    A file that is there and passes its check is kept. One that fails it, there or when it came,
    is moved to the folder ``set-aside`` and fetched once more. Proxies and certificate bundles are
    taken from the environment: ``HTTPS_PROXY``, ``NO_PROXY``, ``REQUESTS_CA_BUNDLE``.

    Parameters
    ----------
    folder : Path
        Where to.
    on_progress : callable, optional
        Called with files and bytes of all calls, by one thread at a time.
    patience : Patience, optional
        With slow and failing servers.
    offline : bool
        Ask nobody: only look at what is there.
    """

    def __init__(
        self,
        folder: Path,
        on_progress: Progress | None = None,
        patience: Patience | None = None,
        offline: bool = False,
    ) -> None:
        self._folder, self._on_progress, self._offline = folder, on_progress, offline
        self._patience = patience or Patience()
        self._lock, self._stopped = threading.Lock(), threading.Event()
        self._done = self._files = self._received = 0
        self._failures: Counter[str] = Counter()
        # A certificate that is refused once (`other`) will be refused again.
        retry = Retry(
            self._patience.tries - 1,
            other=0,
            status_forcelist=_TRY_AGAIN,
            backoff_factor=self._patience.pause,
            # A server may ask for hours.
            respect_retry_after_header=False,
        )
        self._session = requests.Session()
        for scheme in ("http://", "https://"):
            self._session.mount(scheme, HTTPAdapter(max_retries=retry))
        self._session.headers["User-Agent"] = f"dfdbench/{version('dfdbench')}"
        # Sizes are compared with what the server states: nothing may come compressed.
        self._session.headers["Accept-Encoding"] = "identity"

    def bring(self, wanted: Sequence[WantedFile], to_follow: int = 0) -> list[Fate]:
        """Fetch some files, after which so many others will follow; return each one's fate.

        Raises
        ------
        SourceError
            If the disk does not take them.
        """
        self._files = self._done + len(wanted) + to_follow
        pool = ThreadPoolExecutor(CONNECTIONS)
        try:
            return list(pool.map(self._bring, wanted))
        except BaseException:
            # After Ctrl-C or a full disk what runs is broken off.
            self._stopped.set()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _count(self, files: int = 0, received: int = 0) -> None:
        with self._lock:
            self._done, self._received = self._done + files, self._received + received
            if self._on_progress:
                self._on_progress(self._done, self._files, self._received)

    def _bring(self, file: WantedFile) -> Fate:
        fate = self._fate_of(file)
        self._count(files=1)
        return fate

    def _fate_of(self, file: WantedFile) -> Fate:
        path = self._folder / file.name
        refused: tuple[Problem, ...] = ()
        chances = 2
        if path.exists():
            refused = _refusal(file, path, str(path))
            if not refused:
                return Fate(file.name, "kept")
            self._set_aside(path, file.name)
            chances = 1
        part = path.with_name(path.name + ".part")
        unreachable: list[Problem] = []
        lacking: list[str] = []
        to_ask = [] if self._offline else list(file.addresses)
        for address in to_ask:
            try:
                self._download(address, part)
            except _NotThereError as error:
                lacking.append(f"{error} {address}")
                continue
            except _UnreachableError as error:
                unreachable.append(error.problem)
                continue
            refused = _refusal(file, part, address)
            if not refused:
                part.replace(path)
                return Fate(file.name, "new", (), tuple(lacking))
            self._set_aside(part, file.name)
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

    def _set_aside(self, path: Path, name: str) -> None:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
        place = self._folder / SET_ASIDE / f"{name}.{digest}"
        place.parent.mkdir(parents=True, exist_ok=True)
        path.replace(place)

    def _download(self, address: str, part: Path) -> None:
        try:
            host = urlsplit(address).netloc
        except ValueError as error:
            raise _unreachable(address, requests.exceptions.InvalidURL(error)) from error
        if self._failures[host] >= _FAILURES_TO_GIVE_UP:
            got = f"{self._failures[host]} files in a row could not be fetched from it"
            raise _UnreachableError("the server was given up", address, got)
        try:
            part.parent.mkdir(parents=True, exist_ok=True)
            self._receive(address, part)
        except _UnreachableError:
            self._failures[host] += 1
            raise
        except OSError as error:
            what = f"cannot keep the download: {reason_of(error)}"
            fix = room_or("choose another place with --cache DIR", error)
            raise SourceError(what, where=str(part), fix=fix) from error
        self._failures[host] = 0

    def _receive(self, address: str, part: Path) -> None:
        reason = ""
        for _ in range(self._patience.tries):
            silence = self._patience.silence
            try:
                answer = self._session.get(address, stream=True, timeout=silence)
            except requests.exceptions.RequestException as error:
                raise _unreachable(address, error) from error
            with answer:
                if answer.status_code in _NOT_THERE:
                    raise _NotThereError(str(answer.status_code))
                if answer.status_code >= 400:
                    status = f"{answer.status_code} {answer.reason}"
                    raise _UnreachableError("the server refuses", address, status, fix="")
                try:
                    return self._write(answer, part)
                except requests.exceptions.RequestException as error:
                    reason = _short(error)
        raise _UnreachableError("the server does not send the file", address, reason)

    def _write(self, answer: requests.Response, part: Path) -> None:
        with part.open("wb") as out:
            for block in answer.iter_content(_BLOCK):
                if self._stopped.is_set():
                    raise _UnreachableError("the download was stopped", answer.url, "")
                out.write(block)
                self._count(received=len(block))


def _refusal(file: WantedFile, path: Path, where: str) -> tuple[Problem, ...]:
    try:
        file.check(path, where)
    except SourceError as error:
        return error.problems
    return ()


class _NotThereError(Exception):
    """The server has no such file; the text is the status that it answers with."""


class _UnreachableError(Exception):
    """The file may be there but could not be fetched; `problem` says why."""

    def __init__(self, what: str, where: str, got: str, fix: str = _LATER) -> None:
        self.problem = Problem(what, where=where, got=got, fix=fix)
        super().__init__(str(self.problem))


def mirrors_lacking(fates: Sequence[Fate], mirrors: Sequence[str]) -> tuple[Problem, ...]:
    """Return a problem for each mirror that was asked for files that it does not have."""
    answers = [answer for fate in fates for answer in fate.lacking]
    problems = []
    for mirror in mirrors:
        if found := [answer for answer in answers if f" {mirror.rstrip('/')}/" in answer]:
            what = f"the mirror lacks {counted(len(found), 'file')}, such as {found[0]}"
            fix = "name the address that takes the place of the site's .../stereo/data"
            problems.append(Problem(what, where=mirror, fix=fix))
    return tuple(problems)


def _unreachable(address: str, error: requests.exceptions.RequestException) -> _UnreachableError:
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
    return _UnreachableError(what, address, _short(error), fix)


def _short(error: Any) -> str:
    # The reason lies at the bottom of what urllib3 wraps in its pools and retries.
    cause = error
    while cause.args and isinstance(getattr(cause.args[0], "reason", cause.args[0]), Exception):
        cause = getattr(cause.args[0], "reason", cause.args[0])
    text = _CONNECTION.sub("", str(cause))
    return f"{type(cause).__name__}: {text}"[:300]
