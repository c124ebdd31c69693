"""A Python of its own that answers requests: without our environment, or the sight of our files."""

from __future__ import annotations

import codecs
import contextlib
import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import threading
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from dfdbench.errors import DfdbenchError, steering_nothing
from dfdbench.system import landlock
from dfdbench.system.messages import Arrays, receive, send

Facts = Mapping[str, Any]
#: Answers a question that comes in place of an answer.
Serve = Callable[[Facts], tuple[Facts, Mapping[str, Any]]]

# Before anything that `path` leads to is imported, for that may be a stranger's, named like what
# Python brings; and before there are threads. What it says first it says on its own account.
_BEGIN = (
    "import importlib, json, os, runpy, sys; "
    "requests = os.fdopen(os.dup(0), 'rb'); "
    "given = json.loads(requests.readline()); "
    "restrict = runpy.run_path(given['landlock'])['read_only_from']; "
    "os.write(1, b'h' if restrict(given['read'], given['listed']) else b'o'); "
    "sys.path[:] = given['path']; "
    "importlib.import_module(given['module']).main(requests)"
)
# Where libraries, devices and settings of the system lie.
_SYSTEM = (
    *("/bin", "/dev", "/etc", "/lib", "/lib32", "/lib64", "/nix", "/opt", "/sbin", "/snap", "/sys"),
    *("/usr", "/System", "/Library"),
)
_KEPT = ("PATH", "LD_LIBRARY_PATH", "LANG", "TZ", "SYSTEMROOT", "SYSTEMDRIVE", "WINDIR")
_KEPT_BEGINNINGS = (
    *("LC_", "DYLD_", "CUDA_", "NVIDIA_", "PYTORCH_", "NUMBA_", "OPENCV_"),
    *("OMP_", "GOMP_", "KMP_", "MKL_", "OPENBLAS_", "BLIS_", "VECLIB_", "NUMEXPR_"),
)
# How long one that ended may still have something to say, in seconds.
_LAST_WORDS = 2.0
# So many bytes of its standard error are shown; the rest is read, so that it can go on.
_MOST_WORDS = 100_000


class ChildEndedError(Exception):
    """The process is gone, or answers nonsense."""


class Child:
    """A Python of its own that answers requests, each a message of facts and arrays.

    It has a folder of its own for home, working directory and temporary files, and of the
    environment what Python and threads need. Where Linux has Landlock, it reads nothing but the
    system, Python's libraries and the places that it is given. The beginning of what it writes to
    standard error is written to ours.

    Parameters
    ----------
    module : str
        Its ``main(requests)`` is called there, with the stream of requests; it answers on standard
        output, for each request one message. One that has the fact ``ask`` is a question, which
        is served.
    path : sequence of str
        Where it finds modules.
    places : iterable of Path
        What it may read besides.
    hidden : sequence of Path
        What it may not, within all that it may.
    """

    def __init__(
        self, module: str, path: Sequence[str], places: Iterable[Path], hidden: Sequence[Path]
    ) -> None:
        folder = tempfile.mkdtemp(prefix="dfdbench-")
        read, listed = landlock.without([*map(Path, _SYSTEM), *_python(path), *places], hidden)
        self._popen = subprocess.Popen(
            [sys.executable, "-I", "-c", _BEGIN],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env=_environment(folder, hidden),
            # What the keyboard stops is this process, which then stops that one.
            start_new_session=True,
        )
        assert self._popen.stdin
        assert self._popen.stdout
        self._requests = self._popen.stdin
        #: Ends it, once.
        self.end = weakref.finalize(self, _end, self._popen, folder)
        #: Whether the disk is hidden from it; after the first exchange, for it has to say so.
        self.disk_hidden = False
        self._came: queue.SimpleQueue[bool | tuple[Facts, Arrays] | Exception] = queue.SimpleQueue()
        listen = (self._popen.stdout, self._came)
        threading.Thread(target=_listen, args=listen, daemon=True).start()
        threading.Thread(target=_pass_on, args=(self._popen.stderr,), daemon=True).start()
        given = {
            "landlock": landlock.__file__,
            "module": module,
            "path": path,
            "read": [*read, folder],
            "listed": listed,
        }
        with contextlib.suppress(OSError):
            self._requests.write(json.dumps(given).encode() + b"\n")

    @property
    def ended(self) -> bool:
        """Whether nobody is there any more."""
        return not self.end.alive

    def exchange(
        self, facts: Facts, arrays: Mapping[str, Any], serve: Serve | None = None
    ) -> tuple[Facts, Arrays]:
        """Send a request, serve what is asked for in return, and return the answer.

        Raises
        ------
        ChildEndedError
            Where there is none. Whatever is raised, the process is ended with it.
        """
        try:
            self._send(facts, arrays)
            while True:
                told, got = self._receive()
                if "ask" not in told:
                    return told, got
                if serve is None:
                    raise ValueError(f"it asks for {told['ask']}")
                self._send(*serve(told))
        except DfdbenchError:
            self.end()
            raise
        except (ValueError, LookupError, TypeError) as error:
            self.end()
            raise ChildEndedError(f"its process answered nonsense: {error}") from error
        except BaseException:
            self.end()
            raise

    def _send(self, facts: Facts, arrays: Mapping[str, Any]) -> None:
        # Where nobody reads any more, what is received says why.
        with contextlib.suppress(OSError):
            send(self._requests, facts, arrays)

    def _receive(self) -> tuple[Facts, Arrays]:
        while True:
            # What it started may hold the pipe open when it has ended itself.
            gone = self._popen.poll() is not None
            try:
                came = self._came.get(timeout=_LAST_WORDS if gone else 1.0)
            except queue.Empty:
                if not gone:
                    continue
                came = EOFError()
            if isinstance(came, bool):
                self.disk_hidden = came
                continue
            if not isinstance(came, Exception):
                return came
            if isinstance(came, ValueError):
                raise came
            raise ChildEndedError(_why(self._popen))


def _listen(answers: Any, came: queue.SimpleQueue[Any]) -> None:
    try:
        came.put(answers.read(1) == b"h")
        while True:
            came.put(receive(answers))
    except (OSError, EOFError, ValueError) as error:
        came.put(error)


def _pass_on(words: IO[bytes]) -> None:
    left = _MOST_WORDS
    decoder = codecs.getincrementaldecoder("utf-8")("replace")
    with contextlib.suppress(OSError, ValueError), words:
        while chunk := os.read(words.fileno(), 65536):
            text = decoder.decode(chunk[:left])
            left -= len(chunk[:left])
            if text:
                # Where the user looks, and a bar of progress is out of the way.
                sys.stderr.write(steering_nothing(text))
                sys.stderr.flush()


def _why(popen: subprocess.Popen[bytes]) -> str:
    with contextlib.suppress(subprocess.TimeoutExpired):
        popen.wait(_LAST_WORDS)
    status = popen.returncode
    if status is None:
        return "its process closed the way back"
    if status >= 0:
        return f"its process ended with status {status}"
    known = {number.value: number.name for number in signal.Signals}
    name = known.get(-status, "unknown")
    memory = ", perhaps for want of memory" if name == "SIGKILL" else ""
    return f"its process was killed by signal {-status}, {name}{memory}"


def _end(popen: subprocess.Popen[bytes], folder: str) -> None:
    if hasattr(os, "killpg"):
        # With it whatever it has started.
        with contextlib.suppress(OSError):
            os.killpg(popen.pid, signal.SIGKILL)
    popen.kill()
    popen.wait()
    with contextlib.suppress(OSError):
        assert popen.stdin
        popen.stdin.close()
    shutil.rmtree(folder, ignore_errors=True)


def _python(path: Sequence[str]) -> list[Path]:
    places = {*sysconfig.get_paths().values(), sys.prefix, sys.base_prefix, sys.exec_prefix, *path}
    for name, module in sys.modules.items():
        # Packages that are installed as what lies elsewhere.
        if name.startswith("__editable__"):
            places |= {*getattr(module, "MAPPING", {}).values()}
    return [Path(place) for place in sorted(places)]


def _environment(folder: str, hidden: Sequence[Path]) -> dict[str, str]:
    kept = {
        name: value
        for name, value in os.environ.items()
        if (name in _KEPT or name.startswith(_KEPT_BEGINNINGS))
        and not any(str(place) in value for place in hidden)
    }
    return kept | dict.fromkeys(("HOME", "USERPROFILE", "TMPDIR", "TEMP", "TMP"), folder)
