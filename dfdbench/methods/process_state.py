"""Restore what a method changed in the process."""

import contextlib
import functools
import os
import random
import sys
import threading
import warnings
from collections.abc import Iterator

import numpy as np

from dfdbench.errors import InputError

# Seconds after which we say what a call waits for.
_PATIENCE = 60.0
# How to get and set the number of threads in each library.
_THREADS = {
    "cv2": ("getNumThreads", "setNumThreads"),
    "numba": ("get_num_threads", "set_num_threads"),
    "torch": ("get_num_threads", "set_num_threads"),
}


@contextlib.contextmanager
def process_kept() -> Iterator[None]:
    """Undo the block's changes to the process, however it ends.

    This covers the working directory, the environment, Python's recursion limit, NumPy's print
    options and error handling, the warning filters, and the thread counts of OpenCV, Numba and
    PyTorch if they are loaded. A process that the block forked ends with it.

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
    threads, process = _threads(), os.getpid()
    try:
        with np.printoptions(), np.errstate():
            yield
    finally:
        # What a method forked must not go on as a second run.
        if os.getpid() != process:
            error = sys.exc_info()[1]
            os._exit(0 if isinstance(error, SystemExit) and not error.code else 1)
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
        # Only if they changed: `catch_warnings` would show a warning again at each pair.
        if filters != warnings.filters:
            warnings.resetwarnings()
            warnings.filters.extend(filters)  # type: ignore[attr-defined]


@functools.cache
def _lock(process: int) -> threading.RLock:
    return threading.RLock()


@contextlib.contextmanager
def one_at_a_time() -> Iterator[None]:
    """Wait while another thread calls a method: its seeds and printing are the whole process's."""
    lock = _lock(os.getpid())
    while not lock.acquire(timeout=_PATIENCE):
        what = "still waiting for a method that another thread calls; it would be for ever if that"
        warnings.warn(f"{what} method used dfdbench in threads of its own", stacklevel=3)
    try:
        yield
    finally:
        lock.release()


@contextlib.contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Seed `random` and `numpy.random` for the block, and restore their states at its end.

    Raises
    ------
    InputError
        If it is no seed.

    Examples
    --------
    >>> with seeded(3):
    ...     first = random.random(), np.random.random()
    >>> with seeded(3):
    ...     first == (random.random(), np.random.random())
    True
    """
    if not isinstance(seed, int | np.integer) or not 0 <= seed < 2**32:
        expected = "a whole number from 0 to 4294967295"
        raise InputError("not a seed", where="seed", expected=expected, got=repr(seed))
    states = random.getstate(), np.random.get_state()
    random.seed(int(seed))
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
    # Libraries that are not loaded are not loaded for this.
    return {
        name: _numba_threads() if name == "numba" else getattr(sys.modules[name], told)()
        for name, (told, _) in _THREADS.items()
        if hasattr(sys.modules.get(name), told)
    }


def _numba_threads() -> int:
    from dfdbench.system.compiled import numba_threads  # only if numba is loaded already

    return numba_threads()
