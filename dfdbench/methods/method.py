"""What a method is, and what one call of it gives."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    """

    name: str
    entry: str
    predict: Predict
    parameters: dict[str, Any] = field(default_factory=dict)
    uses: tuple[str, ...] = ()
    source_sha256: str | None = None

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
        return str(trained_on) if trained_on else None

    @property
    def paper(self) -> str | None:
        """The publication it comes from, where it says so."""
        paper = getattr(self.predict, "paper", None)
        return str(paper) if paper else None

    @property
    def weights_sha256(self) -> str | None:
        """The SHA-256 of the weights it was given, where it says so."""
        digest = getattr(self.predict, "weights_sha256", None)
        return str(digest) if digest else None

    @functools.cached_property
    def files_sha256(self) -> dict[str, str]:
        """The SHA-256 of the files and folders that parameters name."""
        return files_sha256(self.parameters)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a result should say of how it is used here."""
        return tuple(str(text) for text in getattr(self.predict, "warnings", ()))


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
