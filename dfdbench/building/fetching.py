"""Download files into a folder, several at once; check each, and set bad ones aside."""

import hashlib
import re
import threading
import zipfile
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

import requests
from requests.adapters import HTTPAdapter
from urllib3.util import Retry

from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import Problem, SourceError, reason_of, room_or
from dfdbench.system.array_files import UNREADABLE
from dfdbench.system.files import read_text_as, write_whole
from dfdbench.tables.table import counted

#: Files fetched at once: the servers belong to universities, not to content networks.
CONNECTIONS = 4
SET_ASIDE = "set-aside"
_BLOCK = 64 * 1024
_TRY_AGAIN = (408, 425, 429, *range(500, 600))
_NOT_THERE = (403, 404, 410)
_FAILURES_TO_GIVE_UP = 3
# How often one address is asked for a file; seconds before the third request, doubled before each
# further one; seconds without a byte after which a connection counts as lost.
_TRIES, _PAUSE, _SILENCE = 6, 0.5, 30.0
_CONNECTION = re.compile(r"^<?\w*Connection\w*[(]?[^:]*: ")
_NOT_SENT = "the server does not send the file"
_LATER = "try again later: files that are whole are kept; or name a --mirror URL"

#: Called with (files done, total files, bytes received).
Progress = Callable[[int, int, int], None]


@dataclass(frozen=True)
class WantedFile:
    """A file to fetch.

    Parameters
    ----------
    name : str
        Its path below the folder.
    addresses : tuple of str
        Where to get it, the best first.
    check : callable
        Called with (path, where it came from); raises SourceError if the file is not the expected
        one.
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
        ``"new"``: fetched now. ``"kept"``: already there. ``"missing"``: no address has it.
        ``"unreachable"``: an address may have it, but it could not be fetched. ``"damaged"``: it
        was fetched twice and failed its check.
    problems : tuple of Problem
        What was wrong with it.
    lacking : tuple of str
        The addresses that do not have it, each after its status: ``404 https://...``
    """

    name: str
    kind: Literal["new", "kept", "missing", "unreachable", "damaged"]
    problems: tuple[Problem, ...] = ()
    lacking: tuple[str, ...] = ()

    @property
    def is_there(self) -> bool:
        """Whether the file is in its place."""
        return self.kind in ("new", "kept")


class Fetcher:
    """Fetch files into a folder, each complete and checked, or not at all.

    A file that is there and passes its check is kept. One that fails, old or new, is moved to the
    folder ``set-aside`` and fetched once more. Proxies and certificate bundles are taken from the
    environment: ``HTTPS_PROXY``, ``NO_PROXY``, ``REQUESTS_CA_BUNDLE``.

    Parameters
    ----------
    folder : Path
        Where to save them.
    on_progress : callable, optional
        Called with files and bytes of all calls, by one thread at a time.
    offline : bool
        Ask no server: only look at what is there.
    """

    def __init__(
        self, folder: Path, on_progress: Progress | None = None, offline: bool = False
    ) -> None:
        self._folder, self._on_progress, self._offline = folder, on_progress, offline
        self._lock, self._stopped = threading.Lock(), threading.Event()
        self._done = self._files = self._received = 0
        #: How many files were set aside; the same content of the same name counts once.
        self.refused = 0
        #: Why the last consecutive files were not fetched, by server.
        self._failures: defaultdict[str, list[str]] = defaultdict(list)
        # A certificate that is refused once (`other`) will be refused again.
        retry = Retry(
            _TRIES - 1,
            other=0,
            status_forcelist=_TRY_AGAIN,
            backoff_factor=_PAUSE,
            # A server may ask us to wait for hours.
            respect_retry_after_header=False,
        )
        self._session = requests.Session()
        for scheme in ("http://", "https://"):
            self._session.mount(scheme, HTTPAdapter(max_retries=retry))
        self._session.headers["User-Agent"] = f"dfdbench/{version('dfdbench')}"
        # We compare sizes with what the server states, so nothing may be compressed.
        self._session.headers["Accept-Encoding"] = "identity"

    def bring(self, wanted: Sequence[WantedFile], to_follow: int = 0) -> list[Fate]:
        """Fetch some files and return each one's fate; `to_follow` more will come in later calls.

        Raises
        ------
        SourceError
            If the disk does not accept them.
        """
        self._files = self._done + len(wanted) + to_follow
        pool = ThreadPoolExecutor(CONNECTIONS)
        try:
            return list(pool.map(self._bring, wanted))
        except BaseException:
            # After Ctrl-C or on a full disk, abort the running downloads.
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
                unreachable += error.problems
                continue
            refused = _refusal(file, part, address)
            if not refused:
                part.replace(path)
                return Fate(file.name, "new", (), tuple(lacking))
            self._set_aside(part, file.name)
            chances -= 1
            if not chances:
                break
            # Ask the others first: a server that sent a bad file may well send it again.
            to_ask.append(address)
        if refused:
            return Fate(file.name, "damaged", refused, tuple(lacking))
        if unreachable:
            return Fate(file.name, "unreachable", tuple(unreachable[:1]), tuple(lacking))
        return Fate(file.name, "missing", (), tuple(lacking))

    def _set_aside(self, path: Path, name: str) -> None:
        place = self._folder / SET_ASIDE / f"{name}.{sha256(path.read_bytes())[:12]}"
        place.parent.mkdir(parents=True, exist_ok=True)
        with self._lock:
            self.refused += not place.exists()
        path.replace(place)

    def _download(self, address: str, part: Path) -> None:
        try:
            host = urlsplit(address).netloc
        except ValueError as error:
            raise _unreachable(address, requests.exceptions.InvalidURL(error)) from error
        failures = self._failures[host]
        if len(failures) >= _FAILURES_TO_GIVE_UP:
            got = f"{len(failures)} files in a row not fetched: {failures[-1]}"
            raise _UnreachableError("the server was given up", where=address, got=got, fix=_LATER)
        try:
            part.parent.mkdir(parents=True, exist_ok=True)
            self._receive(address, part)
        except _UnreachableError as error:
            failures.append(error.problems[0].got or error.problems[0].what)
            raise
        except OSError as error:
            raise cannot_keep(part, error) from error
        failures.clear()

    def _receive(self, address: str, part: Path) -> None:
        reason = ""
        for _ in range(_TRIES):
            try:
                answer = self._session.get(address, stream=True, timeout=_SILENCE)
            except requests.exceptions.RequestException as error:
                raise _unreachable(address, error) from error
            with answer:
                if answer.status_code in _NOT_THERE:
                    raise _NotThereError(str(answer.status_code))
                if answer.status_code >= 400:
                    status = f"{answer.status_code} {answer.reason}"
                    raise _UnreachableError("the server refuses", where=address, got=status)
                try:
                    return self._write(answer, part)
                except requests.exceptions.RequestException as error:
                    reason = _short(error)
        raise _UnreachableError(_NOT_SENT, where=address, got=reason, fix=_LATER)

    def _write(self, answer: requests.Response, part: Path) -> None:
        with part.open("wb") as out:
            for block in answer.iter_content(_BLOCK):
                if self._stopped.is_set():
                    raise _UnreachableError("the download was stopped", where=answer.url)
                out.write(block)
                self._count(received=len(block))


def cannot_keep(place: str | Path, error: OSError) -> SourceError:
    """Return an error that says why the disk does not accept a download."""
    fix = room_or("choose another place with --cache DIR", error)
    return SourceError(f"cannot keep the download: {reason_of(error)}", where=str(place), fix=fix)


def _refusal(file: WantedFile, path: Path, where: str) -> tuple[Problem, ...]:
    try:
        file.check(path, where)
    except SourceError as error:
        return error.problems
    return ()


class _NotThereError(Exception):
    """The server has no such file; the text is its HTTP status."""


class _UnreachableError(SourceError):
    """The file may exist but could not be fetched."""


def mirrors_lacking(fates: Sequence[Fate], mirrors: Sequence[str]) -> tuple[Problem, ...]:
    """Return a problem for each mirror that lacks files it was asked for."""
    answers = [answer for fate in fates for answer in fate.lacking]
    problems = []
    for mirror in mirrors:
        if found := [answer for answer in answers if f" {mirror.rstrip('/')}/" in answer]:
            what = f"the mirror lacks {counted(len(found), 'file')}, such as {found[0]}"
            fix = "name the address that takes the place of the site's .../stereo/data"
            problems.append(Problem(what, where=mirror, fix=fix))
    return tuple(problems)


def _unreachable(address: str, error: requests.exceptions.RequestException) -> _UnreachableError:
    what, fix = _NOT_SENT, _LATER
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
    return _UnreachableError(what, where=address, got=_short(error), fix=fix)


def _short(error: Any) -> str:
    # The reason is at the bottom of what urllib3 wraps in its pools and retries.
    cause = error
    while cause.args and isinstance(getattr(cause.args[0], "reason", cause.args[0]), Exception):
        cause = getattr(cause.args[0], "reason", cause.args[0])
    text = _CONNECTION.sub("", str(cause))
    return f"{type(cause).__name__}: {text}"[:300]


_LARGEST = 64 * 2**20  # bytes
# Other methods may take as much memory as the file demands.
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def archive_members(path: Path, where: str = "") -> tuple[str, ...]:
    """Return the names of an archive's files.

    Parameters
    ----------
    path : Path
        A zip file.
    where : str
        The archive's name in messages; its path by default.

    Raises
    ------
    SourceError
        If it is not a zip file.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return tuple(member.filename for member in archive.infolist() if not member.is_dir())
    except UNREADABLE as error:
        what = f"not a zip archive, or a damaged one: {str(error)[:200]}"
        raise SourceError(what, where=where or str(path), fix="fetch it again") from error


def read_member(path: Path, name: str) -> bytes:
    """Return one file of an archive.

    Raises
    ------
    SourceError
        If it is larger than any file of these data sets, is compressed by another method, or does
        not decompress to what the archive states.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            member = archive.getinfo(name)
            if member.file_size > _LARGEST or member.compress_type not in _METHODS:
                raise ValueError(f"{member.file_size} bytes, method {member.compress_type}")
            with archive.open(member) as file:
                # Read one byte more than stated, so that a file that never ends is stopped there.
                content = file.read(member.file_size + 1)
        if len(content) != member.file_size:
            raise ValueError(f"{len(content)} bytes, and {member.file_size} are stated")
    except UNREADABLE as error:
        what, where = f"a file in the archive is damaged: {error}", f"{path}, {name}"
        raise SourceError(what, where=where, fix="fetch the archive again") from error
    return content


_LINE = re.compile(r"([0-9a-f]{64})  (\S.*)")


def sha256(content: bytes) -> str:
    """Return the SHA-256 of some bytes, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def lock_name(manifest: Manifest) -> str:
    """Return the name of a data set's lock file, such as ``middlebury-third-1.lock``."""
    return f"{manifest.file_stem}.lock"


def known_checksums(manifest: Manifest, folder: Path) -> dict[str, str]:
    """Return the SHA-256 of files by name, ``SCENE/...``.

    The manifest's own come first, then those of the lock file that the first complete download
    wrote.

    Parameters
    ----------
    manifest : Manifest
        The data set.
    folder : Path
        Where its downloads are.

    Raises
    ------
    SourceError
        If a lock file is damaged.
    """
    return read_checksums(folder / lock_name(manifest)) | manifest.checksums


def read_checksums(path: Path) -> dict[str, str]:
    """Return the SHA-256 by name from a ``sha256sum`` lock file; none if there is no file.

    Raises
    ------
    SourceError
        If it is damaged.
    """
    if not path.exists():
        return {}
    text = read_text_as(SourceError, path, "the lock file", "delete it")
    known, problems = {}, []
    for number, line in enumerate(text.splitlines(), 1):
        if match := _LINE.fullmatch(line):
            known[match[2]] = match[1]
        else:
            what = f"not SHA-256, two blanks and a name: {line[:80]}"
            where = f"{path}, line {number}"
            problems.append(Problem(what, where=where, fix="delete the lock file"))
    SourceError.raise_if(problems)
    return known


def write_checksums(path: Path, checksums: Mapping[str, str]) -> None:
    """Write a lock file that ``sha256sum --check`` can read."""
    lines = [f"{digest}  {name}\n" for name, digest in sorted(checksums.items())]
    write_whole(path, "".join(lines))


def check_checksum(name: str, content: bytes, known: Mapping[str, str], where: str) -> None:
    """Refuse a file that differs from the known one of its name.

    Raises
    ------
    SourceError
        If its SHA-256 is known and differs.
    """
    expected = known.get(name)
    if expected is not None and sha256(content) != expected:
        got = f"SHA-256 {sha256(content)}, not {expected}"
        fix = "fetch the site's own file again; pixels encoded anew do not count"
        raise SourceError("not the file of this data set", where=where, got=got, fix=fix)
