"""What runs in the processes of tests/system/test_child.py, and whether they end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import IO, Any

from dfdbench.system.messages import receive, send


def gone(process: int, seconds: float = 10) -> bool:
    """Whether a process ends within some seconds; one that nobody has buried is gone, too."""
    for _ in range(int(seconds / 0.05)):
        try:
            os.kill(process, 0)
            state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
        except (ProcessLookupError, FileNotFoundError):
            return True
        if state == "Z":
            return True
        time.sleep(0.05)
    return False


def main(requests: IO[bytes]) -> None:
    """Do what each request says."""
    answers = os.fdopen(os.dup(1), "wb")
    while True:
        facts, arrays = receive(requests)
        told = _done(facts)
        if told is None:
            send(answers, {"ask": "more"}, {})
            told = receive(requests)[0]
        if facts.get("raw"):
            answers.write(bytes.fromhex(facts["raw"]))
            answers.flush()
        else:
            send(answers, told, arrays)


def _done(facts: dict[str, Any]) -> dict[str, Any] | None:
    match facts.get("do"):
        case "exit":
            os._exit(3)
        case "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        case "leave":
            # What is started keeps both pipes open.
            started = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
            Path(facts["note"]).write_text(str(started.pid))
            os._exit(4)
        case "ask":
            return None
        case "shout":
            os.write(2, b"\x1b[2J")
            for _ in range(300):
                os.write(2, "é".encode() * 5000)
            os.close(2)
        case "look":
            return {"environment": dict(os.environ), "folder": os.getcwd(), "path": sys.path}
        case "read":
            try:
                return {"found": Path(facts["place"]).read_text()}
            except PermissionError:
                return {"found": None}
    return {}
