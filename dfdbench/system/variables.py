"""Reject environment variables that crash our dependencies."""

from __future__ import annotations

import re
from collections.abc import Mapping

from dfdbench.errors import InputError, Problem

_COUNT = r"[1-9]\d{0,5}"
_THREADS = "a number of threads, 1 or more"
#: What a variable has to look like, and that in words.
_FORMS = {
    "NUMBA_NUM_THREADS": (_COUNT, _THREADS),
    # OpenMP takes a count for each depth of nesting.
    "OMP_NUM_THREADS": (rf"{_COUNT}(,{_COUNT})*", _THREADS),
    # Compilers date what they write by it, seconds since 1970.
    "SOURCE_DATE_EPOCH": (r"\d{1,11}", "a number of seconds"),
}


def require_sound_start(environment: Mapping[str, str], assertions: bool = __debug__) -> None:
    """Do nothing where libraries can work with what an environment sets.

    Parameters
    ----------
    environment : mapping of str
        The environment's variables.
    assertions : bool, optional
        Whether Python was started with assertions; default: whether this one was.

    Raises
    ------
    InputError
        Naming each variable that no library could read, and a Python without assertions: zarr
        reads a store's groups inside of one.

    Examples
    --------
    >>> require_sound_start({"OMP_NUM_THREADS": "4"}, assertions=True)
    >>> require_sound_start({"OMP_NUM_THREADS": "0"}, assertions=True)
    Traceback (most recent call last):
    dfdbench.errors.InputError: not a number of threads, 1 or more: 0 ...
    """
    problems = [
        Problem(f"not {expected}: {environment[name][:80]}", where=name, fix=f"unset {name}")
        for name, (form, expected) in _FORMS.items()
        if environment.get(name) and not re.fullmatch(form, environment[name].strip())
    ]
    if not assertions:
        what = "Python was started without assertions, which zarr needs"
        problems.append(
            Problem(what, where="PYTHONOPTIMIZE, or python -O", fix="unset PYTHONOPTIMIZE")
        )
    InputError.raise_if(problems)
