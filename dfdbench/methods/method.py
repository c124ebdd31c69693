"""What a method is, and what one call of it gives."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import MethodError, steering_nothing, writable
from dfdbench.methods.importing import attribute_of, unreadable
from dfdbench.methods.parameters import files_sha256
from dfdbench.methods.sources import Hashes, Sources

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
    sources : Sources
        The modules and files that its answers come from.
    """

    name: str
    entry: str
    predict: Predict
    parameters: dict[str, Any] = field(default_factory=dict)
    uses: tuple[str, ...] = ()
    source_sha256: str | None = None
    sources: Sources = field(default_factory=Sources, compare=False, repr=False)

    def __call__(self, infocus: Image, defocus: Image) -> Any:
        """Return the depth of a pair of RGB images, uint8 of shape (y, x, 3)."""
        return self.predict(infocus, defocus)

    @property
    def used(self) -> Hashes:
        """The SHA-256 of the modules and files that its answers came from until now.

        Raises
        ------
        MethodError
            If a module was edited after this process had imported it.
        """
        if self.sources.module_sha256 is None:
            return {self.entry: self.source_sha256}
        return self.sources.hashes()

    def used_again(self, labels: Iterable[str]) -> Hashes:
        """Return the SHA-256 that files have now which an earlier call used, by their labels."""
        if self.sources.module_sha256 is None:
            return self.used
        return self.sources.hashes_again(labels)

    @property
    def warm_up(self) -> Predict | None:
        """What to call once, untimed, before the first pair."""
        warm_up: Predict | None = self.attribute("warm_up")
        return warm_up

    @property
    def fit(self) -> Callable[[Sequence[Any]], Any] | None:
        """What to call once with training pairs before a run; None where nothing is fitted."""
        fit: Callable[[Sequence[Any]], Any] | None = self.attribute("fit")
        return fit

    @property
    def trained_on(self) -> str | None:
        """The data it was trained on, where it says so."""
        return self._said("trained_on")

    @property
    def paper(self) -> str | None:
        """The publication it comes from, where it says so."""
        return self._said("paper")

    @property
    def weights_sha256(self) -> str | None:
        """The SHA-256 of the weights it was given, where it says so.

        Raises
        ------
        MethodError
            Where what it says is none.
        """
        digest = self._said("weights_sha256")
        if digest and not re.fullmatch("[0-9a-f]{64}", digest):
            what = f"not the SHA-256 of weights, nor None: {digest[:100]}"
            raise MethodError(what, where=f"{self.name}: weights_sha256")
        return digest

    @functools.cached_property
    def files_sha256(self) -> dict[str, str]:
        """The SHA-256 of the files and folders that parameters name."""
        return files_sha256(self.parameters)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a result should say of how it is used here."""
        said = self.attribute("warnings")
        try:
            return tuple(_shown(text) for text in said or ())
        except (Exception, SystemExit) as error:
            raise unreadable(self.entry, "warnings", error) from error

    def attribute(self, name: str) -> Any:
        """Return an attribute of what is called, None where it has none.

        Raises
        ------
        MethodError
            Where reading it raises.
        """
        return attribute_of(self.predict, name, self.entry)

    def require_readable(self) -> None:
        """Do nothing where all that a result asks of the method besides depth can be read.

        Raises
        ------
        MethodError
            Where reading one of them raises.
        """
        for name in ("warm_up", "fit", "trained_on", "paper", "weights_sha256", "warnings"):
            getattr(self, name)

    def _said(self, name: str) -> str | None:
        said = self.attribute(name)
        try:
            return _shown(said) if said else None
        except (Exception, SystemExit) as error:
            raise unreadable(self.entry, name, error) from error


def _shown(said: Any) -> str:
    # A result keeps it, and a terminal shows it.
    return steering_nothing(writable(str(said)))


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
