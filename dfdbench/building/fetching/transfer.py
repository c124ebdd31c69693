"""Receive one file over HTTP into a partial file, going on where an earlier try broke off."""

from __future__ import annotations

import json
import re
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import requests

from dfdbench.errors import Problem, SourceError, reason_of, room_or
from dfdbench.system.json_text import parse_json

_BLOCK = 64 * 1024
_TRY_AGAIN = frozenset({408, 416, 425, 429})
_NOT_THERE = frozenset({403, 404, 410})
_LONGEST_PAUSE = 60.0
_FAILURES_TO_GIVE_UP = 3
_CONNECTION = re.compile(r"^<?\w*Connection\w*[(]?[^:]*: ")
_LATER = "try again later: what has come is kept; or name a --mirror URL"


@dataclass(frozen=True)
class Patience:
    """How long to wait for a server, and how often to ask again.

    Parameters
    ----------
    tries : int
        Requests for one file at one address before it is given up.
    pause : float
        Seconds before the second try; doubled before each further one.
    silence : float
        Seconds without a byte after which a connection counts as lost.
    """

    tries: int = 6
    pause: float = 0.5
    silence: float = 30.0


class NotThereError(Exception):
    """The server has no such file; the text is the status that it answers with."""


class UnreachableError(Exception):
    """The file may be there but could not be had; `problem` says why."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(str(problem))
        self.problem = problem


class _FailedTryError(Exception):
    """One try failed; another may not."""

    def __init__(self, got: str, pause: float = 0.0) -> None:
        super().__init__(got)
        self.pause = pause


class Transfer:
    """Receives files; one object serves several threads.

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
        self._threads = threading.local()
        self._failures: Counter[str] = Counter()

    def receive(self, address: str, part: Path) -> None:
        """Receive what an address holds into a partial file.

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
            Where the server has no such file.
        UnreachableError
            Where it could not be had in as many tries as there is patience for, or where that
            happened with several files of the same server already.
        SourceError
            Where the disk does not take it.
        """
        try:
            host = urlsplit(address).netloc
        except ValueError as error:
            raise UnreachableError(_no_address(address, error)) from error
        if self._failures[host] >= _FAILURES_TO_GIVE_UP:
            raise UnreachableError(
                Problem(
                    "the server was given up",
                    where=address,
                    got=f"{self._failures[host]} files in a row could not be had from it",
                    fix=_LATER,
                )
            )
        try:
            self._receive(address, part)
        except UnreachableError:
            self._failures[host] += 1
            raise
        self._failures[host] = 0

    def _receive(self, address: str, part: Path) -> None:
        part.parent.mkdir(parents=True, exist_ok=True)
        reason = "stopped"
        for number in range(self._patience.tries):
            if number:
                self._stopped.wait(self._patience.pause * 2 ** (number - 1))
            if self._stopped.is_set():
                break
            try:
                return self._try(address, part)
            except _FailedTryError as again:
                reason = str(again)
                self._stopped.wait(min(again.pause, _LONGEST_PAUSE))
        raise UnreachableError(
            Problem("the server does not send the file", where=address, got=reason, fix=_LATER)
        )

    def _try(self, address: str, part: Path) -> None:
        try:
            self._request(address, part)
        except requests.exceptions.SSLError as error:
            raise UnreachableError(_tls_problem(address, error)) from error
        except requests.exceptions.ProxyError as error:
            raise UnreachableError(
                Problem(
                    "the proxy does not let us through",
                    where=address,
                    got=_short(error),
                    fix="look at HTTPS_PROXY, HTTP_PROXY and NO_PROXY",
                )
            ) from error
        except (
            requests.exceptions.InvalidURL,
            requests.exceptions.InvalidSchema,
            requests.exceptions.MissingSchema,
        ) as error:
            raise UnreachableError(_no_address(address, error)) from error
        except requests.exceptions.RequestException as error:
            raise _FailedTryError(_short(error)) from error
        except OSError as error:
            raise SourceError(
                "cannot keep the download",
                where=str(part),
                got=reason_of(error),
                fix=room_or("choose another place with --cache DIR", error),
            ) from error

    def _request(self, address: str, part: Path) -> None:
        mark = part.with_name(part.name + ".json")
        have = part.stat().st_size if part.exists() else 0
        headers = _range_of(address, have, mark)
        silence = self._patience.silence
        with self._session().get(
            address, headers=headers, stream=True, timeout=(silence, silence)
        ) as answer:
            if answer.status_code == 416:
                mark.unlink(missing_ok=True)
            _refuse_errors(answer)
            before = have if answer.status_code == 206 else 0
            mark.write_text(json.dumps({"address": address, "validator": _validator(answer)}))
            with part.open("ab" if before else "wb") as out:
                for block in answer.iter_content(_BLOCK):
                    if self._stopped.is_set():
                        raise _FailedTryError("stopped")
                    out.write(block)
                    self._on_bytes(len(block))
            stated = answer.headers.get("Content-Length")
            if stated is not None and part.stat().st_size - before < int(stated):
                raise _FailedTryError(f"{part.stat().st_size - before} of {stated} bytes came")
        mark.unlink()

    def _session(self) -> requests.Session:
        session = getattr(self._threads, "session", None)
        if session is None:
            session = self._threads.session = requests.Session()
            session.headers["User-Agent"] = f"dfdbench/{version('dfdbench')}"
            # Sizes are compared with what the server states: nothing may come compressed.
            session.headers["Accept-Encoding"] = "identity"
        return session


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


def _refuse_errors(answer: requests.Response) -> None:
    status = answer.status_code
    if status in _NOT_THERE:
        raise NotThereError(str(status))
    if status >= 500 or status in _TRY_AGAIN:
        asked = answer.headers.get("Retry-After", "")
        raise _FailedTryError(f"{status} {answer.reason}", float(asked) if asked.isdigit() else 0.0)
    if status >= 400:
        raise UnreachableError(
            Problem("the server refuses", where=answer.url, got=f"{status} {answer.reason}")
        )


def _tls_problem(address: str, error: Exception) -> Problem:
    host = urlsplit(address).hostname
    return Problem(
        f"the certificate of {host} cannot be verified",
        where=address,
        got=_short(error),
        fix="its server may leave out an intermediate certificate: save that one and your "
        "system's bundle into one PEM file and set REQUESTS_CA_BUNDLE=FILE; or use --mirror URL, "
        "or fetch the files otherwise and use --source DIR",
    )


def _no_address(address: str, error: Exception) -> Problem:
    return Problem(
        "not an address", where=address, expected="https://HOST/FOLDER", got=_short(error)
    )


def _short(error: Any) -> str:
    # The reason lies at the bottom of what urllib3 wraps in its pools and retries.
    cause = error
    while cause.args and isinstance(getattr(cause.args[0], "reason", cause.args[0]), Exception):
        cause = getattr(cause.args[0], "reason", cause.args[0])
    text = _CONNECTION.sub("", str(cause))
    return f"{type(cause).__name__}: {text}"[:300]
