"""Compile functions with numba, and cache the machine code where there is a place for it."""

import logging
import os
from collections.abc import Callable
from functools import cache
from multiprocessing import parent_process
from typing import Any

import numba

from dfdbench.errors import InputError
from dfdbench.system.cache import cache_folder

#: The folder of machine code in the cache.
COMPILED = "compiled"


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function on its first call; keep the machine code for later processes.

    Parameters
    ----------
    **options
        Of `numba.njit`, besides ``cache`` and ``nogil``.

    Notes
    -----
    Numba caches in ``NUMBA_CACHE_DIR``, else beside the source; where the package is read-only, the
    machine code goes into our own cache folder. If none can be written, as in a container without a
    home, the function is compiled without a cache, and one warning is logged.

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
                    return numba.njit(cache=True, nogil=True, **options)(function)
                except RuntimeError:
                    continue
        finally:
            # It is everybody's: other packages' functions go where they went.
            config.CACHE_DIR = named
        _warn_once()
        return numba.njit(nogil=True, **options)(function)

    return decorate


def _own_place() -> str:
    try:
        return str(cache_folder() / COMPILED)
    except InputError:
        return ""


@cache
def _warn_once() -> None:
    # Workers would each repeat it.
    if parent_process() is None:
        logging.getLogger("dfdbench").warning(
            "warning: compiled code cannot be cached, so each command compiles it again; "
            "set DFDBENCH_CACHE to a folder that you can write to"
        )
