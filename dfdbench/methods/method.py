"""What a method is, and what one call of it gives."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import MethodError, steering_nothing
from dfdbench.methods.parameters import files_sha256

Image = NDArray[np.uint8]
Predict = Callable[[Image, Image], Any]


@dataclass(frozen=True)
class Method:
    """A method ready to be run.

    Parameters
    ----------
    name : str
        As the user gave it.
    entry : str
        ``module:attribute`` or ``file.py:attribute``.
    predict : callable
        ``predict(infocus, defocus) -> depth``.
    parameters : dict
        What the user set, fit for JSON.
    uses : tuple of str
        Which facts of the data set it was handed, of those offered to `load_method`.
    source_sha256 : str or None
        Of the file it is defined in.
    apart_from : tuple of Path or None
        What is hidden from it, where it runs in a process of its own; None where it runs in this.
    """

    name: str
    entry: str
    predict: Predict
    parameters: dict[str, Any] = field(default_factory=dict)
    uses: tuple[str, ...] = ()
    source_sha256: str | None = None
    apart_from: tuple[Path, ...] | None = None

    @property
    def warm_up(self) -> Predict | None:
        """What to call once, untimed, before the first pair."""
        return getattr(self.predict, "warm_up", None)

    @property
    def fit(self) -> Callable[[Sequence[Any]], Any] | None:
        """What to call once with training pairs before a run; None where nothing is fitted."""
        return getattr(self.predict, "fit", None)

    @property
    def trained_on(self) -> str | None:
        """The data it was trained on, where it says so."""
        trained_on = getattr(self.predict, "trained_on", None)
        return _shown(trained_on) if trained_on else None

    @property
    def paper(self) -> str | None:
        """The publication it comes from, where it says so."""
        paper = getattr(self.predict, "paper", None)
        return _shown(paper) if paper else None

    @property
    def weights_sha256(self) -> str | None:
        """The SHA-256 of the weights it was given, where it says so.

        Raises
        ------
        MethodError
            Where what it says is none.
        """
        digest = getattr(self.predict, "weights_sha256", None)
        if digest and not re.fullmatch("[0-9a-f]{64}", str(digest)):
            raise MethodError(
                "not the SHA-256 of weights",
                where=f"{self.name}: weights_sha256",
                expected="64 hexadecimal digits, or None",
                got=_shown(digest)[:100],
            )
        return str(digest) if digest else None

    @functools.cached_property
    def files_sha256(self) -> dict[str, str]:
        """The SHA-256 of the files and folders that parameters name."""
        return files_sha256(self.parameters)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a result should say of how it is used here."""
        return tuple(_shown(text) for text in getattr(self.predict, "warnings", ()))


def _shown(said: Any) -> str:
    # A result keeps it, and a terminal shows it.
    return steering_nothing(writable(str(said)))


def writable(text: str) -> str:
    r"""Return a text with what no file can hold, a lone surrogate, spelt out.

    Examples
    --------
    >>> print(writable("depth \ud800"))
    depth \ud800
    """
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


@dataclass(frozen=True)
class Prediction:
    """What one call gave: a depth map, or the reason why there is none.

    Parameters
    ----------
    depth : ndarray of float32, shape (y, x), or None
        Depth levels.
    seconds : float
        Wall-clock time of the call.
    error : str
        Why there is no depth; empty where there is one.
    printed : str
        What the method wrote to standard output.
    numbers : dict of str to float
        What the method said of its answer besides, an energy for example.
    """

    depth: NDArray[np.float32] | None
    seconds: float
    error: str = ""
    printed: str = ""
    numbers: dict[str, float] = field(default_factory=dict)
