"""What a method is, and what one call of it gives."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import MethodError, steering_nothing, writable
from dfdbench.methods.importing import attribute_of, unreadable
from dfdbench.methods.parameters import files_sha256
from dfdbench.methods.sources import Hashes, Sources
from dfdbench.metrics.protocol import Unit

if TYPE_CHECKING:
    import xarray

Image = NDArray[np.uint8]
Predict = Callable[..., Any]


class CaptureImages(Protocol):
    """The images of a capture, as a method is called with them."""

    @property
    def is_pair(self) -> bool:
        """Whether they are an in-focus and a defocus image."""

    @property
    def infocus(self) -> Image:
        """The in-focus image, RGB, shape (y, x, 3)."""

    @property
    def defocus(self) -> Image:
        """The defocus image, RGB, shape (y, x, 3)."""

    @property
    def stack(self) -> xarray.DataArray:
        """All images, dimensions (image, y, x, channel), with what is known of them."""


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
        ``predict(infocus, defocus) -> depth`` or ``predict(stack) -> depth``, told apart by the
        name of the first parameter. What has ``from_stack(stack)`` besides does both.
    parameters : dict
        What the user set, fit for JSON.
    uses : tuple of str
        Which facts of the data set it was handed, of those offered to `load_method`.
    source_sha256 : str or None
        Of the file it is defined in.
    images : tuple of int, optional
        The two images of a stack that it gets as a pair.
    sources : Sources
        The modules and files that its answers come from.
    """

    name: str
    entry: str
    predict: Predict
    parameters: dict[str, Any] = field(default_factory=dict)
    uses: tuple[str, ...] = ()
    source_sha256: str | None = None
    images: tuple[int, int] | None = None
    sources: Sources = field(default_factory=Sources, compare=False, repr=False)

    def __call__(self, *images: Any) -> Any:
        """Return the depth of an in-focus and a defocus image, or of a stack.

        Parameters
        ----------
        *images : ndarray of uint8, shape (y, x, 3), or DataArray
            Two RGB images; or a stack, dimensions (image, y, x, channel), as `Capture.stack`.
        """
        of_stack = len(images) == 1 and not self.takes_stack and self.attribute("from_stack")
        return (of_stack or self.predict)(*images)

    @functools.cached_property
    def takes_stack(self) -> bool:
        """Whether it is called with a stack alone: its first parameter is called so."""
        try:
            return next(iter(inspect.signature(self.predict).parameters), "") == "stack"
        except Exception:  # a signature of its own may raise anything
            return False

    def two_images(self, usual: Sequence[int] | None) -> Sequence[int] | None:
        """Return which two images of a capture it gets as a pair; None for all of them.

        Parameters
        ----------
        usual : sequence of int, optional
            Those that the data set names for methods that know no stack.
        """
        if self.images or self.takes_stack or self.attribute("from_stack"):
            return self.images
        return usual

    def called_on(self, capture: CaptureImages) -> tuple[Predict, tuple[Any, ...]]:
        """Return what to call for a capture, and with what."""
        if self.takes_stack:
            return self.predict, (capture.stack,)
        of_stack = self.attribute("from_stack")
        if of_stack and not capture.is_pair:
            return of_stack, (capture.stack,)
        return self.predict, (capture.infocus, capture.defocus)

    def answers_in(self, unit: Unit) -> Unit:
        """Return what its depth is in on a data set in this unit: levels unless it says so.

        Raises
        ------
        MethodError
            If what it says is no unit.
        """
        units: dict[str, Unit] = {"levels": "levels", "metres": "metres", "stack": unit}
        said = self._said("unit") or "levels"
        if said not in units:
            expected = "levels, metres, or stack: as the data set"
            raise MethodError("no unit", where=f"{self.name}: unit", expected=expected, got=said)
        return units[said]

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
        self.answers_in("levels")
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
