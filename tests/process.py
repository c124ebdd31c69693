"""Other processes, and what they said."""

import os
import subprocess
import sys
from pathlib import Path


def shell(line: str, cwd: Path | None = None, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a line of the shell, with these variables beside those of this process."""
    return _run(["sh", "-c", line], cwd, variables)


def python(
    *words: str | bytes | Path, cwd: Path | None = None, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run Python on these words, as `shell` runs a line."""
    return _run([sys.executable, *words], cwd, variables)


def _run(
    words: list[str | bytes | Path], cwd: Path | None, variables: dict[str, str]
) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, **variables}
    return subprocess.run(
        words, cwd=cwd, env=environment, capture_output=True, text=True, timeout=1200, check=False
    )
