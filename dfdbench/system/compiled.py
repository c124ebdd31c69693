"""Compile functions with numba, and cache the machine code if there is a place for it."""

import logging
import os
from collections.abc import Callable, Sequence
from functools import cache
from multiprocessing import parent_process
from typing import Any

import numba

from dfdbench.errors import InputError, reason_of
from dfdbench.system.cache import cache_folder
from dfdbench.system.parallel import Item, Outcome, Threads

#: The folder of machine code in the cache.
COMPILED = "compiled"


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function on its first call; keep the machine code for later processes.

    Parameters
    ----------
    **options
        Options of `numba.njit`, besides ``cache`` and ``nogil``.

    Notes
    -----
    Numba caches in ``NUMBA_CACHE_DIR``, else beside the source; if the package is read-only, the
    machine code goes into our own cache folder. If none of these is writable, as in a container
    without a home, the function is compiled without a cache, and one warning is logged. So it is
    if the disk is full.

    Examples
    --------
    >>> @compiled()
    ... def double(number):
    ...     return 2 * number
    >>> double(21)
    42
    """

    def decorate(function: Callable[..., Any]) -> Any:
        config: Any = numba.config
        named = config.CACHE_DIR
        beside = os.access(os.path.dirname(function.__code__.co_filename), os.W_OK)
        try:
            for place in ([named] if named or beside else []) + [_own_place()]:
                config.CACHE_DIR = place
                try:
                    return _kept_if_there_is_room(
                        numba.njit(cache=True, nogil=True, **options)(function)
                    )
                except RuntimeError:
                    continue
        finally:
            # The setting is global, so restore it for other packages' functions.
            config.CACHE_DIR = named
        _warn_once("set DFDBENCH_CACHE to a folder that you can write to")
        return numba.njit(nogil=True, **options)(function)

    return decorate


def numba_threads() -> int:
    """Return how many threads numba uses, without starting them: that would reset PyTorch's."""
    try:
        numba.threading_layer()  # type: ignore[attr-defined]
    except ValueError:
        return int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
    return int(numba.get_num_threads())


def in_threads(function: Callable[[Item], Outcome], items: Sequence[Item]) -> list[Outcome]:
    """Return a function's result for each item, computed in as many threads as numba may use.

    It is for compiled code, OpenCV and large arrays, which let other threads run. numba takes one
    thread per core, or what the environment variable ``NUMBA_NUM_THREADS`` says.

    Examples
    --------
    >>> in_threads(abs, [-1, -2])
    [1, 2]
    """
    return Threads(numba.config.NUMBA_NUM_THREADS).map(function, items)  # type: ignore[attr-defined]


def _own_place() -> str:
    try:
        return str(cache_folder() / COMPILED)
    except InputError:
        return ""


def _kept_if_there_is_room(function: Any) -> Any:
    # With NUMBA_DISABLE_JIT it is not compiled.
    if not hasattr(function, "_cache"):
        return function
    save = function._cache.save_overload

    def try_to_save(*given: Any) -> None:
        # Raised here, it would look as if the caller's own files could not be written.
        try:
            save(*given)
        except OSError as error:
            _warn_once(f"{reason_of(error)}: set NUMBA_CACHE_DIR to a folder with room")

    function._cache.save_overload = try_to_save
    return function


@cache
def _warn_once(fix: str) -> None:
    # Each worker would repeat it.
    if parent_process() is None:
        what = "compiled code cannot be cached, so each command compiles it again"
        logging.getLogger("dfdbench").warning("warning: %s; %s", what, fix)
