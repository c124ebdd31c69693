"""Compile functions with numba, and cache the machine code where there is a place for it."""

import logging
from collections.abc import Callable
from functools import cache
from multiprocessing import parent_process
from typing import Any

import numba


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function on its first call; keep the machine code for later processes.

    Parameters
    ----------
    **options
        Of `numba.njit`, besides ``cache`` and ``nogil``.

    Notes
    -----
    Numba caches in ``NUMBA_CACHE_DIR``, else beside the source, else in the user's cache folder.
    If none can be written, as in a container without a home, it raises; here the function is
    compiled without a cache instead, and one warning is logged.

    Examples
    --------
    >>> @compiled()
    ... def double(number):
    ...     return 2 * number
    >>> double(21)
    42
    """

    def decorate(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:
            _warn_once()
            return numba.njit(nogil=True, **options)(function)

    return decorate


@cache
def _warn_once() -> None:
    # Workers would each repeat it.
    if parent_process() is None:
        logging.getLogger("dfdbench").warning(
            "warning: compiled code cannot be cached, so each command compiles it again; "
            "set NUMBA_CACHE_DIR to a folder that you can write to"
        )
