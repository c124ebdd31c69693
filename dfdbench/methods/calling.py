"""Call a method on one pair, so that nothing it does can spoil a run."""

import contextlib
import functools
import inspect
import io
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.errors import writable
from dfdbench.methods.importing import describe, where_raised
from dfdbench.methods.method import DepthMap, Image, Predict, Prediction
from dfdbench.methods.process_state import process_kept
from dfdbench.metrics.protocol import Unit
from dfdbench.metrics.scores import LARGEST_NUMBER


class TorchMethod:
    """A network as a method, in evaluation mode and without gradients.

    It has the network's attributes, so that `fit` or `trained_on` are found.

    Parameters
    ----------
    network : torch.nn.Module
        Called as ``network(infocus, defocus)``.
    """

    def __init__(self, network: Any) -> None:
        self.network = network
        network.eval()

    def __call__(self, infocus: Image, defocus: Image, **parameters: Any) -> Any:
        """Return what the network returns."""
        # Not `inference_mode`: a network may itself enable gradients for part of its work.
        with sys.modules["torch"].no_grad():
            # At each call, since its own fit or forward may have called train().
            return self.network.eval()(infocus, defocus, **parameters)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the network."""
        return getattr(self.__dict__["network"], name)


def as_method(found: Any) -> Any:
    """Wrap a network in a `TorchMethod`; return anything else as it is.

    Examples
    --------
    >>> as_method(len) is len
    True
    """
    # If PyTorch is not loaded, it is not a network.
    torch = sys.modules.get("torch")
    is_network = torch is not None and isinstance(found, torch.nn.Module)
    return TorchMethod(found) if is_network else found


class WithArguments:
    """A function or an object that is called with further arguments, and otherwise as it is.

    A ``functools.partial`` would hide its unit, its fit and what it was trained on.
    """

    def __init__(self, target: Any, given: Mapping[str, Any]) -> None:
        self._target, self._given = target, given

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(functools.partial(self._target, **self._given))

    def __call__(self, *images: Any) -> Any:
        """Return what it returns for images, shape (y, x, 3), and the further arguments."""
        return self._target(*images, **self._given)

    def __getattr__(self, name: str) -> Any:
        # A copy asks for special methods before it has a target.
        if name.startswith("_"):
            raise AttributeError(name)
        found = getattr(self._target, name)
        with_them = name == "from_stack" and callable(found)
        return functools.partial(found, **self._given) if with_them else found


def without_gradient(returned: Any) -> Any:
    """Move a tensor to the CPU without its gradient, for NumPy; return anything else as it is.

    Examples
    --------
    >>> without_gradient([1, 2])
    [1, 2]
    """
    torch = sys.modules.get("torch")
    is_tensor = torch is not None and isinstance(returned, torch.Tensor)
    return returned.detach().cpu() if is_tensor else returned


# Each becomes a row in every table of a run.
_MOST_NUMBERS = 100
# A level this far outside 0..255 is rounding, not a mistake.
_ROUNDING = 1e-3

#: Metres, shares of depth and class indices are below this; levels of a whole scene hardly ever.
SMALL_LEVEL = 10
#: The warning for depth maps that seem to hold something other than levels.
FEW_LEVELS = (
    f"all levels between 0 and {SMALL_LEVEL}; levels go from 0 (far) to 255 (near): "
    "is it in metres, or to be multiplied by 255?"
)


def call(predict: Predict, *images: Any, unit: Unit = "levels") -> Prediction:
    """Call a method on one capture and check what it returns; catch whatever it raises.

    Parameters
    ----------
    predict : callable
        The method, or its ``from_stack``.
    *images : ndarray of uint8, shape (y, x, 3), or DataArray
        Its arguments: an in-focus and a defocus image, or a stack of dimensions (image, y, x,
        channel). The method gets copies.
    unit : {"levels", "metres"}
        The unit of its answer.

    Notes
    -----
    Numbers for the result, such as an energy, are read after the call from the method's attribute
    ``numbers``, which maps at most 100 names to the values of the last call.

    Changes that the method makes to the process are undone: see `process_kept`.

    Examples
    --------
    >>> image = np.zeros((2, 2, 3), np.uint8)
    >>> call(lambda infocus, defocus: [[1, 2], [3, 4]], image, image).depth.tolist()
    [[1.0, 2.0], [3.0, 4.0]]
    >>> call(lambda infocus, defocus: infocus, image, image).error
    'returned shape (2, 2, 3); expected (2, 2), one number a pixel'
    >>> call(lambda infocus, defocus: (np.ones((2, 2)), np.full((2, 2), 5)), image, image).sigma
    array([[5., 5.],
           [5., 5.]], dtype=float32)
    """
    copies = [image.copy() for image in images]
    printed = _Printed()
    depth, sigma, error = None, None, ""
    numbers: dict[str, float] = {}
    begin = time.perf_counter()
    try:
        with process_kept(), contextlib.redirect_stdout(printed):
            begin = time.perf_counter()
            returned = predict(*copies)
            seconds = time.perf_counter() - begin
            owner = getattr(predict, "__self__", predict)
            numbers = _finite_numbers(getattr(owner, "numbers", None))
    except KeyboardInterrupt:
        raise
    except BaseException as raised:
        error = f"raised {describe(raised)}{where_raised(raised)}"
        seconds = time.perf_counter() - begin
    else:
        try:
            if (count := len(numbers)) > _MOST_NUMBERS:
                numbers, most = {}, f"expected {_MOST_NUMBERS} at most"
                raise ValueError(f"keeps {count:,} values in `numbers`; {most}")
            depth, sigma = check_answer(returned, images[0].shape[-3:-1], unit)
        except ValueError as wrong:
            error = str(wrong)
    return Prediction(depth, seconds, writable(error), writable(printed.getvalue()), numbers, sigma)


class _Printed(io.StringIO):
    """What a method prints, which is kept even if the method closes its standard output."""

    def close(self) -> None:
        pass


def check_answer(
    returned: Any, shape: tuple[int, ...], unit: Unit = "levels"
) -> tuple[DepthMap, DepthMap | None]:
    """Return a method's answer as float32.

    Parameters
    ----------
    returned : object
        What the method returned: a depth map, NaN where it has no answer; or a tuple of depth and
        sigma, the standard deviation that it gives each pixel.
    shape : tuple of int
        The shape of the images, (y, x).
    unit : {"levels", "metres"}
        The unit of both.

    Returns
    -------
    depth : ndarray of float32, shape (y, x)
        Levels 0 to 255, or metres above 0; NaN where there is no answer.
    sigma : ndarray of float32, shape (y, x), or None
        Above 0, and NaN where there is no answer. None if the method gives none.

    Raises
    ------
    ValueError
        If the answer is invalid; it says what is wrong.

    Examples
    --------
    >>> check_answer(np.full((2, 2), 300), (2, 2))
    Traceback (most recent call last):
    ValueError: returned levels from 300 to 300; expected 0 to 255
    >>> check_answer((np.ones((1, 2)),) * 3, (1, 2))
    Traceback (most recent call last):
    ValueError: returned a tuple of 3; expected depth, or a tuple (depth, sigma)
    >>> check_answer((np.ones((1, 2)), np.zeros((1, 2))), (1, 2))
    Traceback (most recent call last):
    ValueError: returned sigma of 0 to 0; expected finite numbers above 0 wherever there is depth
    """
    if returned is None:
        raise ValueError("returned None; expected a depth map: is a `return` missing?")
    if not isinstance(returned, tuple):
        return _checked_depth(returned, shape, unit), None
    if any(isinstance(part, Mapping) for part in returned):
        got = "returned a depth map and numbers; expected the depth map alone"
        fix = "keep numbers in the method's attribute `numbers`, from which a result takes them"
        raise ValueError(f"{got}: {fix}")
    # A tuple of two rows is no depth map that anyone returns.
    if len(returned) != 2:
        try:
            return _checked_depth(returned, shape, unit), None
        except ValueError as error:
            got = f"returned a tuple of {len(returned)}"
            raise ValueError(f"{got}; expected depth, or a tuple (depth, sigma)") from error
    depth = _checked_depth(returned[0], shape, unit)
    answered = ~np.isnan(depth)
    with np.errstate(over="ignore"):
        sigma = np.where(answered, _as_array(returned[1], shape, "sigma of "), np.nan)
        sigma = sigma.astype(np.float32)
    given = sigma[answered]
    if not (np.isfinite(given) & (given > 0)).all():
        got = f"{given.min():g} to {given.max():g}"
        expected = "finite numbers above 0 wherever there is depth"
        raise ValueError(f"returned sigma of {got}; expected {expected}")
    return depth, sigma


def _checked_depth(returned: Any, shape: tuple[int, ...], unit: Unit) -> DepthMap:
    array = _as_array(returned, shape)
    answered = ~np.isnan(array)
    if np.isinf(array).any():
        raise ValueError(f"returned infinity in {np.isinf(array).sum()} of {array.size} pixels")
    if not answered.any():
        raise ValueError(f"returned NaN, no answer, in all of {array.size} pixels")
    low, high = array[answered].min(), array[answered].max()
    if unit == "metres":
        if low <= 0:
            got = f"returned distances from {low:g} to {high:g} m"
            raise ValueError(f"{got}; expected all above 0")
        return array.astype(np.float32)
    if low < -_ROUNDING or high > LAST_LEVEL + _ROUNDING:
        got = f"returned levels from {low:g} to {high:g}"
        raise ValueError(f"{got}; expected 0 to {LAST_LEVEL}")
    return np.clip(array.astype(np.float32), 0, LAST_LEVEL)


def _as_array(returned: Any, shape: tuple[int, ...], what: str = "") -> NDArray[Any]:
    if isinstance(returned, np.ma.MaskedArray) and np.ma.is_masked(returned):
        got = f"an array with {np.count_nonzero(returned.mask)} masked pixels"
        raise ValueError(f"returned {what}{got}; expected NaN for those")
    try:
        array = np.asarray(without_gradient(returned))
    except (Exception, SystemExit) as error:
        got = f"a {type(returned).__name__} that is no array"
        raise ValueError(f"returned {what}{got}: {describe(error)}") from error
    if array.dtype.kind not in "uif":
        raise ValueError(f"returned {what}{array.dtype} values; expected real numbers")
    if array.shape != shape:
        expected = f"expected {shape}, one number a pixel"
        raise ValueError(f"returned {what}shape {array.shape}; {expected}")
    return array


def difference(one: DepthMap | None, other: DepthMap | None) -> str:
    """Describe how two answers to one pair differ, ignoring rounding.

    Parameters
    ----------
    one, other : ndarray of float32, shape (y, x), or None
        Depth, in one unit, NaN where there is no answer; None if the call returned no depth map.

    Examples
    --------
    >>> difference(np.float32([[1, 2]]), np.float32([[1, 7]]))
    'differs in 1 of 2 pixels, by up to 5'
    >>> difference(np.float32([[1, np.nan]]), np.float32([[1, 7]]))
    'answers 1 of 2 pixels only one time in two'
    >>> difference(None, None), difference(None, np.float32([[1]]))
    ('', 'gives a depth map only one time in two')
    """
    if one is None or other is None:
        return "" if one is other else "gives a depth map only one time in two"
    if gaps := np.count_nonzero(np.isnan(one) != np.isnan(other)):
        return f"answers {gaps} of {one.size} pixels only one time in two"
    apart = np.nan_to_num(np.abs(one - other))
    count = np.count_nonzero(apart > _ROUNDING)
    if not count:
        return ""
    return f"differs in {count} of {apart.size} pixels, by up to {apart.max():.3g}"


def in_few_levels(depth: DepthMap) -> bool:
    """Return whether a depth map holds only levels from 0 to 10, but not just zeros.

    Parameters
    ----------
    depth : ndarray of float32, shape (y, x)
        Levels 0 to 255, some not NaN.

    Examples
    --------
    >>> in_few_levels(np.float32([[0, 0.5]])), in_few_levels(np.float32([[0, 20]]))
    (True, False)
    """
    return bool(0 < np.nanmax(depth) <= SMALL_LEVEL)


def _finite_numbers(given: Any) -> dict[str, float]:
    # Leave out strings, infinities and the like, which a result could not average.
    numbers = {}
    for name, value in given.items() if isinstance(given, Mapping) else ():
        numeric = isinstance(value, (int, float, np.integer, np.floating))
        if numeric and abs(value) <= LARGEST_NUMBER:
            numbers[str(name)] = float(value)
    return numbers
