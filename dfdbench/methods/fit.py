"""Call any method's `fit` on training pairs, check what it learned, and give that back to it.

What the package's own methods share in theirs is `fitted.py`.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import DfdbenchError, MethodError, Problem
from dfdbench.methods.importing import error_of
from dfdbench.methods.method import CaptureImages, Method
from dfdbench.methods.process_state import process_kept, seeded

#: What a fit may return: numbers and arrays of numbers by name.
Learned = dict[str, bool | int | float | NDArray[Any]]

_EXPECTED = "a mapping of names to numbers or NumPy arrays of numbers, or None"


class TrainingPair(CaptureImages, Protocol):
    """What a fit sees of a capture."""

    @property
    def depth(self) -> NDArray[np.float32]:
        """Depth in the data set's unit, shape (y, x); NaN where it is not known."""

    @property
    def levels(self) -> NDArray[np.uint8]:
        """Depth levels."""

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True where the depth is known."""


@dataclass(frozen=True)
class Lesson:
    """What one call of a fit came to.

    Parameters
    ----------
    learned : dict or None
        Numbers and arrays by name; None where the method keeps what it learned in itself.
    seconds : float
        Wall-clock time of the call.
    """

    learned: Learned | None
    seconds: float


def teach(method: Method, pairs: Sequence[TrainingPair], seed: int = 0) -> Lesson:
    """Call a method's fit, check what it returns, and give it back to the method.

    `random` and `numpy.random` are seeded for the call; what it prints goes to standard error,
    since a command's tables go to standard output; what it changes of the process is put back.

    Raises
    ------
    MethodError
        Where the fit raises, or returns what cannot be kept.
    DfdbenchError
        What reading a pair raises.

    Examples
    --------
    >>> class Mean:
    ...     def fit(self, pairs):
    ...         return {"level": np.mean([pair.depth[pair.valid].mean() for pair in pairs])}
    ...
    ...     def restore(self, learned):
    ...         self.level = learned["level"]
    ...
    ...     def __call__(self, infocus, defocus):
    ...         return np.full(infocus.shape[:2], self.level)
    >>> from types import SimpleNamespace
    >>> depth = np.full((2, 2), 90, np.float32)
    >>> pair = SimpleNamespace(depth=depth, valid=depth > 0)
    >>> teach(Method("mean", "m:Mean", Mean()), [pair, pair]).learned
    {'level': 90.0}
    """
    fit = method.fit
    if not callable(fit):
        what = f"fit cannot be called, it is a {type(fit).__name__}"
        raise MethodError(what, where=method.entry, expected="fit(pairs), or None")
    try:
        with (
            process_kept(),
            seeded(seed),
            contextlib.redirect_stdout(sys.stderr),
            method.sources.watch(),
        ):
            begin = time.perf_counter()
            returned = fit(pairs)
            seconds = time.perf_counter() - begin
    except DfdbenchError:
        raise
    except (Exception, SystemExit) as error:
        raise error_of("the method cannot be fitted", f"{method.entry}: fit", error) from error
    learned = None if returned is None else check_learned(returned, method.entry)
    if learned is not None:
        restore(method, learned)
    return Lesson(learned, seconds)


def restore(method: Method, learned: Learned) -> None:
    """Give a method what its fit learned, here or in another process; arrays are copies.

    Raises
    ------
    MethodError
        Where it has no `restore`, or that raises.
    """
    give = method.attribute("restore")
    if not callable(give):
        what = "the method's fit returns what it learned, and nothing takes it back"
        fix = "add restore(learned), or let fit return None and keep it in the object"
        raise MethodError(what, where=method.entry, fix=fix)
    copies = {
        name: value.copy() if isinstance(value, np.ndarray) else value
        for name, value in learned.items()
    }
    try:
        with process_kept(), contextlib.redirect_stdout(sys.stderr), method.sources.watch():
            give(copies)
    except DfdbenchError:
        raise
    except (Exception, SystemExit) as error:
        raise error_of(
            "the method does not take back what it learned", f"{method.entry}: restore", error
        ) from error


def check_learned(returned: Any, entry: str) -> Learned:
    """Return what a fit returned as numbers and arrays that a file can hold.

    Of an array some numbers may be NaN, for what training did not show; a number alone, or a whole
    array of them, would say nothing.

    Raises
    ------
    MethodError
        Where something of it is neither a number nor an array of numbers, or is none; all is named.

    Examples
    --------
    >>> check_learned({"sigma": np.float32(0.5), "levels": (1, 2)}, "m:f")
    {'sigma': 0.5, 'levels': array([1, 2])}
    """
    if not isinstance(returned, Mapping):
        what = f"what the fit learned cannot be kept: a {type(returned).__name__}"
        raise MethodError(what, where=f"{entry}: fit", expected=_EXPECTED)
    try:
        items = list(returned.items())
    except (Exception, SystemExit) as error:
        raise error_of("what the fit learned cannot be read", f"{entry}: fit", error) from error
    learned: Learned = {}
    problems = []
    for name, value in items:
        array = _as_numbers(value)
        problem = _what_is_wrong(name, value, array, entry)
        if problem:
            problems.append(problem)
        elif array is not None:
            learned[name] = array if array.ndim else array.item()
    if problems:
        raise MethodError.of(problems)
    return learned


def _what_is_wrong(
    name: object, value: object, array: NDArray[Any] | None, entry: str
) -> Problem | None:
    if not isinstance(name, str) or not name:
        return Problem(f"what the fit learned has no text as name: {name!r}", where=f"{entry}: fit")
    if array is None:
        what = f"what the fit learned cannot be kept: a {type(value).__name__}"
        return Problem(what, where=f"{entry}: fit, {name!r}", expected=_EXPECTED)
    if array.size and not np.isfinite(array).any():
        return Problem(
            f"what the fit learned is not finite: {array.flat[0]}", where=f"{entry}: fit, {name!r}"
        )
    return None


def _as_numbers(value: Any) -> NDArray[Any] | None:
    try:
        array = np.array(value)
    except (Exception, SystemExit):
        return None
    return array if array.dtype.kind in "biuf" else None
