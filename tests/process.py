"""Other processes, and what they said."""

import os
import subprocess
import sys
from pathlib import Path


def shell(line: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a line of the shell, with these variables beside those of this process."""
    return _run(["sh", "-c", line], None, variables)


def python(
    *words: str | bytes | Path, cwd: Path | None = None, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run Python on these words, as `shell` runs a line."""
    return _run([sys.executable, *words], cwd, variables)


def dfdbench_without(
    package: str, *words: str, cwd: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run the command line where a package cannot be imported, as if it were not installed."""
    code = (
        f"import sys; sys.modules['{package}'] = None\n"
        "from dfdbench.cli import main\n"
        "sys.argv = ['dfdbench', *sys.argv[1:]]\n"
        "main()\n"
    )
    return python("-c", code, *words, cwd=cwd)


def _run(
    words: list[str | bytes | Path], cwd: Path | None, variables: dict[str, str]
) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, **variables}
    return subprocess.run(
        words, cwd=cwd, env=environment, capture_output=True, text=True, timeout=1200, check=False
    )
