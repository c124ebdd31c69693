"""Describe the machine and the versions that something ran on."""

import os
import platform
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import cv2
import numpy as np

from dfdbench.results.record import Environment

_PACKAGES = (
    *("dfdbench", "numpy", "numba", "opencv-python-headless", "scikit-image", "scipy"),
    *("torch", "onnxruntime"),
)


def describe_environment() -> Environment:
    """Return versions, processor, threads, GPU and the checkout's commit.

    Examples
    --------
    >>> describe_environment().versions["dfdbench"] == version("dfdbench")
    True
    """
    # numba is slow to import, and a run with nothing to do does not need it.
    from dfdbench.system.compiled import numba_threads

    # Only if the method has loaded PyTorch: asking must not load it.
    torch = sys.modules.get("torch")
    threads = {"opencv": cv2.getNumThreads(), "numba": numba_threads()}
    return Environment(
        python=platform.python_version(),
        platform=f"{platform.system()} {platform.machine()}",
        cpu=_processor(),
        cpu_count=os.cpu_count() or 1,
        threads=threads | ({"torch": torch.get_num_threads()} if torch else {}),
        gpu=str(torch.cuda.get_device_name()) if torch and torch.cuda.is_available() else None,
        git=_commit(),
        versions={name: found for name in _PACKAGES if (found := _version(name))},
    )


def software() -> dict[str, str | None]:
    """Return the versions and the processor architecture on which depth maps depend.

    Examples
    --------
    >>> software()["numpy"] == np.__version__
    True
    """
    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        **{name: _version(name) for name in ("numba", "torch", "onnxruntime")},
        "architecture": platform.machine(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _commit() -> str | None:
    checkout = Path(__file__).resolve().parents[2]
    if not (checkout / ".git").exists():
        return None
    commit = _git(checkout, "describe", "--always", "--abbrev=12")
    # Results that are being submitted do not count as changes to the code.
    changed = _git(
        checkout, "status", "--porcelain", "--untracked-files=no", "--", ".", ":!leaderboard"
    )
    return f"{commit}-dirty" if commit and changed else commit


def _git(checkout: Path, *arguments: str) -> str | None:
    command = ["git", "-C", str(checkout), *arguments]
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip() or None
