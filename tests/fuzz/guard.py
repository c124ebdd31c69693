"""Watch an input: what it writes, which hosts it asks, what it takes of memory and time."""

import errno
import faulthandler
import os
import resource
import signal
import socket
import sys
from pathlib import Path
from typing import Any

#: More than what was there before an input.
MEMORY = 2**30
#: Of the processor: on a machine that is busy with other things a second lasts longer.
CPU_SECONDS = 10
#: Where libraries keep what is theirs, one folder for all of them.
LIBRARIES = ("MPLCONFIGDIR", "TORCHINDUCTOR_CACHE_DIR")
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_ASK = {"socket.connect", "socket.getaddrinfo", "socket.gethostbyname", "socket.sendto"}
_FIRST = "os.mkdir os.remove os.rmdir os.truncate os.chmod os.chown os.utime shutil.rmtree"
_SECOND = "os.link os.symlink shutil.move"
_PATHS: dict[str, tuple[int, ...]] = {"os.rename": (0, 1), **dict.fromkeys(_FIRST.split(), (0,))}
_PATHS |= dict.fromkeys(_SECOND.split(), (1,))


class Guard:
    """Refuses writes outside a folder and all of the network; keeps what was refused.

    Once made it stays for as long as the process does.
    """

    def __init__(self) -> None:
        self.folder: Path | None = None
        self.refused: list[str] = []
        # Where a hang hangs, before the signal ends the process.
        faulthandler.register(signal.SIGXCPU, all_threads=False, chain=True)
        faulthandler.enable()
        sys.addaudithook(self._look)

    def _look(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.folder is None:
            return
        if event == "open":
            path, _, flags = arguments
            if isinstance(flags, int) and flags & _WRITES:
                self._refuse_outside(event, path)
        elif event in _PATHS:
            for number in _PATHS[event]:
                self._refuse_outside(event, arguments[number])
        elif event in _ASK:
            if event == "socket.getaddrinfo":
                raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
            raise OSError(errno.ENETUNREACH, "Network is unreachable")

    def _refuse_outside(self, event: str, path: Any) -> None:
        if not isinstance(path, (str, bytes, os.PathLike)):
            return
        try:
            full = os.path.realpath(os.fsdecode(path))
        except ValueError:
            return
        inside = full == str(self.folder) or full.startswith(f"{self.folder}{os.sep}")
        # matplotlib lists its fonts once, PyTorch makes a folder for what it may compile; numba
        # keeps what it compiled beside the source.
        own = full.startswith(os.environ[LIBRARIES[0]]) or "__pycache__" in full
        if inside or own or full.startswith("/dev/"):
            return
        self.refused.append(f"{event} {full}")
        raise PermissionError(errno.EACCES, "Permission denied", os.fsdecode(path))

    def begin(self, folder: Path, limited: bool) -> None:
        """Watch from here on; without limits where something is called for the first time."""
        self.refused.clear()
        self.folder = folder.resolve()
        status = Path("/proc/self/status").read_text()
        data = 1024 * int(status.partition("VmData:")[2].split()[0])
        used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
        most = resource.RLIM_INFINITY
        resource.setrlimit(resource.RLIMIT_DATA, (data + MEMORY if limited else most, most))
        seconds = int(used) + 1 + CPU_SECONDS if limited else most
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, most))

    def end(self) -> list[str]:
        """Stop watching; return what was refused."""
        self.folder = None
        most = resource.RLIM_INFINITY
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
        resource.setrlimit(resource.RLIMIT_CPU, (most, most))
        return list(self.refused)
