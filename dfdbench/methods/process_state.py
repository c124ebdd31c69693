"""Restore what a method changed in the process."""

import contextlib
import os
import random
import sys
import warnings
from collections.abc import Iterator

import numpy as np

# How libraries tell and take the number of threads that they work with.
_THREADS = {
    "cv2": ("getNumThreads", "setNumThreads"),
    "numba": ("get_num_threads", "set_num_threads"),
    "torch": ("get_num_threads", "set_num_threads"),
}


@contextlib.contextmanager
def process_kept() -> Iterator[None]:
    """Put back what the block changed of the process, however it ends.

    That is the working directory, the environment, Python's limit of recursion, NumPy's print
    options and error handling, the filters of warnings, and the numbers of threads of OpenCV, Numba
    and PyTorch where they are loaded.

    Examples
    --------
    >>> with process_kept():
    ...     os.environ["DFDBENCH_EXAMPLE"] = "set by a method"
    ...     np.set_printoptions(precision=1)
    >>> "DFDBENCH_EXAMPLE" in os.environ, np.array(0.25)
    (False, array(0.25))
    """
    folder = _working_directory()
    environment = dict(os.environ)
    filters = list(warnings.filters)
    depth = sys.getrecursionlimit()
    threads = _threads()
    try:
        with np.printoptions(), np.errstate():
            yield
    finally:
        sys.setrecursionlimit(depth)
        if folder and folder != _working_directory():
            # A method may even have removed it.
            with contextlib.suppress(FileNotFoundError):
                os.chdir(folder)
        for name in os.environ.keys() - environment.keys():
            del os.environ[name]
        for name, value in environment.items():
            if os.environ.get(name) != value:
                os.environ[name] = value
        for name, number in _threads().items():
            if name in threads and threads[name] != number:
                getattr(sys.modules[name], _THREADS[name][1])(threads[name])
        # Only where they changed: `catch_warnings` would show a warning anew at each pair.
        if filters != warnings.filters:
            warnings.resetwarnings()
            warnings.filters.extend(filters)  # type: ignore[attr-defined]


@contextlib.contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Seed `random` and `numpy.random` for the block; put their states back at its end.

    Examples
    --------
    >>> with seeded(3):
    ...     first = random.random(), np.random.random()
    >>> with seeded(3):
    ...     first == (random.random(), np.random.random())
    True
    """
    states = random.getstate(), np.random.get_state()
    random.seed(seed)
    np.random.seed(seed)
    try:
        yield
    finally:
        random.setstate(states[0])
        np.random.set_state(states[1])


def _working_directory() -> str | None:
    try:
        return os.getcwd()
    except FileNotFoundError:
        return None


def _threads() -> dict[str, int]:
    # What is not loaded is not loaded for this.
    return {
        name: getattr(sys.modules[name], told)()
        for name, (told, _) in _THREADS.items()
        if hasattr(sys.modules.get(name), told)
    }
