"""What a method is, what one call returns, and what its fit learns from training captures.

The code that the fits of our own methods share is in `fitted.py`.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import DfdbenchError, MethodError, Problem, spelt_out
from dfdbench.methods.importing import attribute_of, error_of
from dfdbench.methods.parameters import files_sha256
from dfdbench.methods.process_state import one_at_a_time, process_kept, seeded
from dfdbench.methods.sources import Hashes, Sources
from dfdbench.metrics.protocol import Unit
from dfdbench.tables.table import Table, as_html

if TYPE_CHECKING:
    import xarray

Image = NDArray[np.uint8]
#: Depth, or how sure a method is of it: shape (y, x).
DepthMap = NDArray[np.float32]
Predict = Callable[..., Any]


#: What a fit may return: numbers and arrays of numbers, by name.
Learned = dict[str, bool | int | float | NDArray[Any]]

_EXPECTED = "a mapping of names to numbers or NumPy arrays of numbers, or None"


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
        """All images, dimensions (image, y, x, channel), with what is known about each."""


@dataclass(frozen=True)
class Method:
    """A method that is ready to run.

    Parameters
    ----------
    name : str
        The name as the user gave it.
    entry : str
        ``module:attribute`` or ``file.py:attribute``.
    predict : callable
        ``predict(infocus, defocus) -> depth`` or ``predict(stack) -> depth``, distinguished by the
        name of the first parameter. With a ``from_stack(stack)`` as well, it takes both.
    parameters : dict
        The parameters that the user set, fit for JSON.
    uses : tuple of str
        The facts of the data set that it was given, of those offered to `load_method`.
    images : tuple of int, optional
        The two images of a stack that it gets as a pair.
    sources : Sources
        The modules and files that its answers depend on.
    """

    name: str
    entry: str
    predict: Predict
    parameters: dict[str, Any] = field(default_factory=dict)
    uses: tuple[str, ...] = ()
    images: tuple[int, int] | None = None
    sources: Sources = field(default_factory=Sources, compare=False)

    def __repr__(self) -> str:
        given = "".join(f" {name}={value}" for name, value in self.parameters.items())
        return f"<{self.name}{given}>"

    def _repr_html_(self) -> str:
        given = ((name, str(value)) for name, value in self.parameters.items())
        return as_html(Table(self.name, ("fact", "value"), (("entry", self.entry), *given), "ll"))

    def __call__(self, *images: Any) -> Any:
        """Return the depth of an in-focus and a defocus image, or of a stack.

        Parameters
        ----------
        *images : ndarray of uint8, shape (y, x, 3), or DataArray
            Two RGB images; or a stack, dimensions (image, y, x, channel), like `Capture.stack`.

        Raises
        ------
        MethodError
            If it takes a stack but got two images, or one image that is no stack; or if the images
            are not RGB of 8 bits or differ in shape.
        """
        if self.takes_stack and len(images) > 1:
            fix = "call it with a capture's stack, or choose a method of pairs"
            raise MethodError("the method takes a stack, and no pair", where=self.name, fix=fix)
        if len(shapes := dict.fromkeys(map(np.shape, images))) > 1:
            got = " and ".join(map(str, shapes))
            raise MethodError("the images differ in shape", where=self.name, got=got)
        for image in images if len(images) > 1 else ():
            kind, shape = getattr(image, "dtype", type(image).__name__), np.shape(image)
            if kind != np.uint8 or len(shape) != 3 or shape[2] != 3:
                got, fix = f"{kind} {shape}", "dfdbench.predict also takes others"
                what = "not an RGB image of 8 bits, shape (y, x, 3)"
                raise MethodError(what, where=self.name, got=got, fix=fix)
        if len(images) != 1:
            return self.predict(*images)
        if getattr(images[0], "dims", None) != ("image", "y", "x", "channel"):
            what, got = "neither two images nor a stack", type(images[0]).__name__
            expected = "capture.infocus, capture.defocus; or capture.stack"
            raise MethodError(what, where=self.name, expected=expected, got=got)
        of_stack = None if self.takes_stack else self.attribute("from_stack")
        return (of_stack or self.predict)(*images)

    @functools.cached_property
    def takes_stack(self) -> bool:
        """Whether it takes only stacks: its first parameter is named ``stack``."""
        try:
            return next(iter(inspect.signature(self.predict).parameters), "") == "stack"
        except Exception:  # its own `__signature__` may raise anything
            return False

    def two_images(self, usual: Sequence[int] | None) -> Sequence[int] | None:
        """Return which two images of a capture it gets as a pair; None for all of them.

        Parameters
        ----------
        usual : sequence of int, optional
            The two that the data set names for methods that do not take stacks.
        """
        if self.images or self.takes_stack or self.attribute("from_stack"):
            return self.images
        return usual

    def called_on(self, capture: CaptureImages) -> tuple[Predict, tuple[Any, ...]]:
        """Return the callable for a capture and its arguments."""
        if self.takes_stack:
            return self.predict, (capture.stack,)
        of_stack = self.attribute("from_stack")
        if of_stack and not capture.is_pair:
            return of_stack, (capture.stack,)
        return self.predict, (capture.infocus, capture.defocus)

    def answers_in(self, unit: Unit) -> Unit:
        """Return the unit of its depth on a data set in this unit: levels unless it says otherwise.

        Raises
        ------
        MethodError
            If it names an invalid unit.
        """
        units: dict[str, Unit] = {"levels": "levels", "metres": "metres", "stack": unit}
        said = self._said("unit") or "levels"
        if said not in units:
            expected = "levels, metres, or stack: as the data set"
            raise MethodError("no unit", where=f"{self.name}: unit", expected=expected, got=said)
        return units[said]

    @property
    def source_sha256(self) -> str | None:
        """The SHA-256 of the file that it is defined in; None if it is in no file."""
        return self.sources.module_sha256

    @property
    def used(self) -> Hashes:
        """The SHA-256 of the modules and files that its answers have depended on so far.

        Raises
        ------
        MethodError
            If a module was edited after this process imported it.
        """
        if self.source_sha256 is None:
            return {self.entry: None}
        return self.sources.hashes()

    def used_again(self, labels: Iterable[str]) -> Hashes:
        """Return the present SHA-256 of the files that an earlier call used, by their labels."""
        if self.source_sha256 is None:
            return self.used
        return self.sources.hashes_again(labels)

    @property
    def warm_up(self) -> Predict | None:
        """What to call once, untimed, before the first pair."""
        warm_up: Predict | None = self.attribute("warm_up")
        return warm_up

    @property
    def learner(self) -> Callable[[Sequence[Any]], Any] | None:
        """What to call once with training captures before a run; None if nothing is fitted."""
        learner: Callable[[Sequence[Any]], Any] | None = self.attribute("fit")
        return learner

    def fit(self, captures: Sequence[Any], seed: int = 0) -> Method:
        """Fit the method to captures, keep what it learned, and return it.

        Parameters
        ----------
        captures : sequence of Capture
            Captures with depth, as from `Dataset.captures`.
        seed : int
            Set in `random` and `numpy.random` for the fit.

        Raises
        ------
        MethodError
            If the method has no fit, or its fit raises or returns something that cannot be kept.
        """
        teach(self, captures, seed)
        return self

    @property
    def trained_on(self) -> str | None:
        """The data it was trained on, if it says so."""
        return self._said("trained_on")

    @property
    def paper(self) -> str | None:
        """The publication it comes from, if it says so."""
        return self._said("paper")

    @property
    def weights_sha256(self) -> str | None:
        """The SHA-256 of the weights it was given, if it says so.

        Raises
        ------
        MethodError
            If it is not a SHA-256.
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
        """What the method wants results to say about its use here."""
        return tuple(_shown(text) for text in self.attribute("warnings") or ())

    def attribute(self, name: str) -> Any:
        """Return an attribute of the callable, or None if it has none.

        Raises
        ------
        MethodError
            If reading it raises.
        """
        return attribute_of(self.predict, name, self.entry)

    def require_readable(self) -> None:
        """Raise if an attribute that results need cannot be read.

        Raises
        ------
        MethodError
            If reading one of them raises.
        """
        self.answers_in("levels")
        for name in ("warm_up", "learner", "trained_on", "paper", "weights_sha256", "warnings"):
            getattr(self, name)

    def _said(self, name: str) -> str | None:
        said = self.attribute(name)
        return _shown(said) if said else None


def _shown(said: Any) -> str:
    # Results keep it and terminals show it.
    return spelt_out(str(said))


@dataclass(frozen=True)
class Prediction:
    """What one call returned: a depth map, or the reason why there is none.

    Parameters
    ----------
    depth : ndarray of float32, shape (y, x), or None
        Depth levels; NaN where the method has no answer.
    seconds : float
        Wall-clock time of the call.
    error : str
        Why there is no depth; empty if there is.
    printed : str
        What the method wrote to standard output.
    numbers : dict of str to float
        Other numbers that the method gave for this call, such as an energy.
    sigma : ndarray of float32, shape (y, x), or None
        The standard deviation that the method gives each pixel, if any.
    """

    depth: DepthMap | None
    seconds: float
    error: str = ""
    printed: str = ""
    numbers: dict[str, float] = field(default_factory=dict)
    sigma: DepthMap | None = None


class DepthUnit(Protocol):
    """What a fit sees of a data set's unit of depth."""

    @property
    def kind(self) -> Unit:
        """Levels or metres."""

    def of_unit(self, depth: NDArray[np.float32], unit: Unit) -> NDArray[np.float32]:
        """Return depth in levels or metres in this kind."""


class TrainingPair(CaptureImages, Protocol):
    """What a fit sees of a capture."""

    @property
    def depth(self) -> NDArray[np.float32]:
        """Depth in the data set's unit, shape (y, x); NaN where it is unknown."""

    @property
    def about(self) -> DepthUnit:
        """What the depth means: the manifest's section."""

    @property
    def levels(self) -> NDArray[np.uint8]:
        """Depth levels."""

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True where the depth is known."""


def teach(
    method: Method, pairs: Sequence[TrainingPair], seed: int = 0
) -> tuple[Learned | None, float]:
    """Call a method's fit, check what it returns, and give it back to the method.

    `random` and `numpy.random` are seeded for the call. Its output goes to standard error, since a
    command's tables go to standard output. Changes that it makes to the process are undone.

    Returns
    -------
    learned : dict or None
        Numbers and arrays by name; None if the method keeps what it learned in itself.
    seconds : float
        Wall-clock time of the call.

    Raises
    ------
    MethodError
        If the fit raises, or returns something that cannot be kept.
    DfdbenchError
        If reading a pair raises it.

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
    >>> teach(Method("mean", "m:Mean", Mean()), [pair, pair])[0]
    {'level': 90.0}
    """
    fit = method.learner
    if not callable(fit):
        what = f"fit cannot be called, it is a {type(fit).__name__}"
        raise MethodError(what, where=method.entry, expected="fit(pairs), or None")
    with _running(method, "the method cannot be fitted", "fit"), seeded(seed):
        begin = time.perf_counter()
        returned = fit(pairs)
        seconds = time.perf_counter() - begin
    learned = None if returned is None else check_learned(returned, method.entry)
    if learned is not None:
        restore(method, learned)
    return learned, seconds


def restore(method: Method, learned: Learned) -> None:
    """Give a method what its fit learned, here or in another process; arrays are copies.

    Raises
    ------
    MethodError
        If it has no `restore`, or that raises.
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
    with _running(method, "the method does not take back what it learned", "restore"):
        give(copies)


@contextlib.contextmanager
def _running(method: Method, what: str, name: str) -> Iterator[None]:
    """Run the method's own code, and turn its exceptions, but not ours, into a MethodError."""
    try:
        with (
            one_at_a_time(),
            process_kept(),
            contextlib.redirect_stdout(sys.stderr),
            method.sources.watch(),
        ):
            yield
    except DfdbenchError:
        raise
    except (Exception, SystemExit) as error:
        raise error_of(what, f"{method.entry}: {name}", error) from error


def check_learned(returned: Any, entry: str) -> Learned:
    """Convert what a fit returned to numbers and arrays that a file can hold.

    An array may contain some NaN, for what training did not show. A single NaN, or an array of
    nothing else, is refused.

    Raises
    ------
    MethodError
        If a value is neither a number nor an array of numbers, or has no finite number; it names
        every such value.

    Examples
    --------
    >>> check_learned({"sigma": np.float32(0.5), "levels": (1, 2)}, "m:f")
    {'sigma': 0.5, 'levels': array([1, 2])}
    """
    if not isinstance(returned, Mapping):
        what = f"what the fit learned cannot be kept: a {type(returned).__name__}"
        raise MethodError(what, where=f"{entry}: fit", expected=_EXPECTED)
    learned: Learned = {}
    problems = []
    for name, value in returned.items():
        array = _as_numbers(value)
        where = f"{entry}: fit, {name!r}"
        if not isinstance(name, str) or not name:
            what = f"what the fit learned has no text as name: {name!r}"
            problems.append(Problem(what, where=f"{entry}: fit"))
        elif array is None:
            what = f"what the fit learned cannot be kept: a {type(value).__name__}"
            problems.append(Problem(what, where=where, expected=_EXPECTED))
        elif array.size and not np.isfinite(array).any():
            what = f"what the fit learned is not finite: {array.flat[0]}"
            problems.append(Problem(what, where=where))
        else:
            learned[name] = array if array.ndim else array.item()
    MethodError.raise_if(problems)
    return learned


def _as_numbers(value: Any) -> NDArray[Any] | None:
    try:
        array = np.array(value)
    except ValueError:
        return None
    return array if array.dtype.kind in "biuf" else None
