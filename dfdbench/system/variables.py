"""Environment variables that libraries read as they are imported: checked before they do."""

from __future__ import annotations

import re
from collections.abc import Mapping

from dfdbench.errors import InputError, Problem

_COUNT = r"[1-9]\d{0,5}"
#: What numba takes; OpenMP takes a count for each depth of nesting, with commas.
_FORMS = {"NUMBA_NUM_THREADS": _COUNT, "OMP_NUM_THREADS": rf"{_COUNT}(,{_COUNT})*"}


def require_thread_counts(environment: Mapping[str, str]) -> None:
    """Do nothing where the numbers of threads in an environment are such.

    Raises
    ------
    InputError
        Naming each variable that is none.

    Examples
    --------
    >>> require_thread_counts({"OMP_NUM_THREADS": "4"})
    >>> require_thread_counts({"OMP_NUM_THREADS": "0"})
    Traceback (most recent call last):
    dfdbench.errors.InputError: wrong environment variable
      where     OMP_NUM_THREADS
      expected  a number of threads, 1 or more
      got       0
      fix       unset OMP_NUM_THREADS
    """
    problems = [
        Problem(
            "wrong environment variable",
            where=name,
            expected="a number of threads, 1 or more",
            got=environment[name][:80],
            fix=f"unset {name}",
        )
        for name, form in _FORMS.items()
        if environment.get(name) and not re.fullmatch(form, environment[name].strip())
    ]
    if problems:
        raise InputError.of(problems)
