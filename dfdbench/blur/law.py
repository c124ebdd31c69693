"""A blur law: how much each depth level is blurred, where that is measured and not prescribed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS
from dfdbench.errors import InputError, Problem

#: The field that only a law has, and no recipe.
SIGMAS = "sigmas"
#: At how many grey levels a measured law has its noise.
GREYS = 17
#: Variance of rounding to whole grey levels.
ROUNDING_VARIANCE = 1 / 12


@dataclass(frozen=True)
class BlurLaw:
    """How a defocus image comes about: a blur by depth level, gain, offset, noise.

    Parameters
    ----------
    sigmas : tuple of float
        For each depth level, from 0, the standard deviation in pixels of the Gaussian that is as
        wide as its kernel. Any curve: a lens may focus inside the range.
    exponent : float
        p of the kernels ``exp(-(r / c)^p)``: 2 is the Gaussian, 32 nearly a disk.
    kernel_size : int
        Side of the square kernels in pixels, odd.
    gain, offset : float
        The defocus image is the blurred in-focus image times `gain`, plus `offset` grey levels.
    noise : tuple of float
        Standard deviation in grey levels of what the defocus image has besides, where it shows
        grey levels evenly from 0 to 255; between them it runs straight. One value stands for all.
    infocus_noise : float
        The in-focus image's noise, which is blurred with it, as a part of the defocus image's.
    linear : bool
        True: all that is of linear light, which the sRGB curve encodes; `offset` and `noise` are
        then in 255ths of white.
    registered : bool
        False: pairs are moved against each other, each its own way.
    even : bool
        False: the gain is another in each pair; `gain` is its mean.

    Raises
    ------
    InputError
        For a field out of range, all of them named.

    Examples
    --------
    >>> law = BlurLaw(sigmas=(1.0, 0.5, 1.0), kernel_size=5)
    >>> law.levels, law.kernels().shape
    (3, (3, 5, 5))
    """

    sigmas: tuple[float, ...]
    exponent: float = 2.0
    kernel_size: int = 27
    gain: float = 1.0
    offset: float = 0.0
    noise: tuple[float, ...] = (0.0,)
    infocus_noise: float = 0.0
    linear: bool = False
    registered: bool = True
    even: bool = True

    def __post_init__(self) -> None:
        size = self.kernel_size
        fits = {
            "sigmas": (
                isinstance(self.sigmas, tuple)
                and 2 <= len(self.sigmas) <= LEVELS
                and all(_is_number(sigma) and 0 < sigma <= 1000 for sigma in self.sigmas),
                f"2 to {LEVELS} numbers above 0, one a depth level",
            ),
            "exponent": (_is_number(self.exponent) and 1 <= self.exponent <= 64, "1 to 64"),
            "kernel_size": (_is_whole(size) and 0 < size < 1000 and size % 2 == 1, "odd, positive"),
            "gain": (_is_number(self.gain) and 0 < self.gain <= 1000, "a number above 0"),
            "offset": (_is_number(self.offset), "a number"),
            "noise": (
                isinstance(self.noise, tuple)
                and 1 <= len(self.noise) <= LEVELS
                and all(_is_number(sigma) and sigma >= 0 for sigma in self.noise),
                f"1 to {LEVELS} numbers, 0 or more, at grey levels evenly from 0 to 255",
            ),
            "infocus_noise": (
                _is_number(self.infocus_noise) and self.infocus_noise >= 0,
                "a number, 0 or more",
            ),
            "linear": (isinstance(self.linear, bool), "true or false"),
            "registered": (isinstance(self.registered, bool), "true or false"),
            "even": (isinstance(self.even, bool), "true or false"),
        }
        problems = [
            Problem(
                "wrong blur law", where=name, expected=expected, got=repr(getattr(self, name))[:80]
            )
            for name, (right, expected) in fits.items()
            if not right
        ]
        if problems:
            raise InputError.of(problems)

    @property
    def levels(self) -> int:
        """How many depth levels it has."""
        return len(self.sigmas)

    def depth_of_level(self, level: Any) -> Any:
        """Return the depth level of a blur level: a law counts by depth, so it is the same."""
        return level

    def kernels(self) -> NDArray[np.float64]:
        """Return the 2-D kernel of each depth level, (levels, kernel_size, kernel_size)."""
        return self._kernels

    @cached_property
    def _kernels(self) -> NDArray[np.float64]:
        sigmas = np.array(self.sigmas, np.float64)
        kernels = point_spread_functions(sigmas, self.kernel_size, self.exponent)
        kernels.flags.writeable = False
        return kernels

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name, fit for JSON and TOML."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()
        }

    def as_toml(self) -> str:
        """Return the law as a TOML file says it, for ``--param recipe=FILE.toml``.

        Examples
        --------
        >>> print(BlurLaw(sigmas=(1.0, 0.5), noise=(0.25,)).as_toml().splitlines()[0])
        sigmas = [1.0, 0.5]
        """
        lines = []
        for name, value in self.as_dict().items():
            text = str(value).lower() if isinstance(value, bool) else repr(value)
            lines.append(f"{name} = {text}\n")
        return "".join(lines)


def law_of_fields(given: Mapping[str, Any]) -> BlurLaw:
    """Return a law from its fields by name.

    Raises
    ------
    InputError
        If a field is unknown, of the wrong type or out of range, or `sigmas` is lacking.

    Examples
    --------
    >>> law_of_fields({"sigmas": [1.0, 0.5]}).levels
    2
    """
    known = [field.name for field in fields(BlurLaw)]
    problems = [
        Problem(what="unknown field of a blur law", expected=", ".join(known), got=str(name))
        for name in given
        if name not in known
    ]
    if SIGMAS not in given:
        problems.append(Problem(what="a field of the blur law is lacking", expected=SIGMAS))
    if problems:
        raise InputError.of(problems)
    found: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in given.items()
    }
    return BlurLaw(**found)


def noise_at(noise: ArrayLike, grey: NDArray[Any]) -> NDArray[np.float64]:
    """Return a law's noise at some grey levels.

    Examples
    --------
    >>> noise_at((1.0, 3.0), np.array([0, 127.5, 255])).tolist()
    [1.0, 2.0, 3.0]
    """
    values = np.asarray(noise, np.float64)
    return np.asarray(np.interp(grey, np.linspace(0, LAST_LEVEL, values.size), values))


def _is_number(value: Any) -> bool:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and math.isfinite(value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
