"""A blur law: how much each depth level is blurred, as measured rather than prescribed."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, FiniteFloat
from pydantic_core import to_jsonable_python

from dfdbench.blur.light import Floats
from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS, KernelSize
from dfdbench.errors import InputError
from dfdbench.system.strict import STEPS, Share, check_fields, made_of
from dfdbench.system.text import toml_text

#: The field that a law has and a recipe has not.
SIGMAS = "sigmas"
#: The number of grey levels at which a measured law gives the noise.
GREYS = 17
#: Variance of rounding to whole grey levels.
ROUNDING_VARIANCE = 1 / 12
_Sigma = Annotated[float, Field(gt=0, le=1000)]
_Shift = Annotated[float, Field(ge=-100, le=100)]
_Turn = Annotated[float, Field(ge=-0.5, le=0.5)]
_Size = Annotated[float, Field(ge=-0.3, le=0.3)]
_Noise = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class BlurLaw:
    """How a defocus image comes about: blur by depth level, gain, offset and noise.

    Parameters
    ----------
    sigmas : tuple of float
        For each depth level, from 0, the standard deviation in pixels of the Gaussian that is as
        wide as its kernel. The curve may have any shape: a lens may focus inside the range.
    exponent : float
        p of the kernels ``exp(-(r / c)^p)``: 2 is the Gaussian, 32 nearly a disk.
    kernel_size : int
        Side of the square kernels in pixels, odd.
    gain, offset : float
        The defocus image is the blurred in-focus image times `gain`, plus `offset` grey levels.
    noise : tuple of float
        Standard deviation of the defocus image's noise, in grey levels, at grey levels spaced
        evenly from 0 to 255, with linear interpolation. A single value holds for all.
    infocus_noise : float
        The in-focus image's noise, as a fraction of the defocus image's. It is blurred together
        with the in-focus image.
    linear : bool
        True: all of this applies to linear light, which the sRGB curve encodes; `offset` and
        `noise` are then in 255ths of white.
    registered : bool
        False: the images of each pair are shifted against each other, differently in each pair.
    even : bool
        False: the gain differs from pair to pair, and `gain` is its mean.
    similarity : tuple of float
        How the defocus image's view differs, the same in all pairs: pixels down, pixels right,
        rotation in radians and magnification (0.006 for 0.6 %), both about the middle.
    falloff : tuple of tuple of float
        Each channel's light in the defocus image, as a fraction of the in-focus image's, at even
        steps of r^2 from the middle to the corners, with linear interpolation. One curve holds for
        all channels; an empty tuple means that both images fall off alike.

    Raises
    ------
    InputError
        If fields are out of range; it names all of them.

    Examples
    --------
    >>> law = BlurLaw(sigmas=(1.0, 0.5, 1.0), kernel_size=5)
    >>> law.levels, law.kernels().shape
    (3, (3, 5, 5))
    """

    sigmas: Annotated[tuple[_Sigma, ...], Field(min_length=2, max_length=LEVELS)]
    exponent: Annotated[float, Field(ge=1, le=64)] = 2.0
    kernel_size: Annotated[KernelSize, Field(lt=1000)] = 27
    gain: _Sigma = 1.0
    offset: FiniteFloat = 0.0
    noise: Annotated[tuple[_Noise, ...], Field(min_length=1, max_length=LEVELS)] = (0.0,)
    infocus_noise: _Noise = 0.0
    linear: bool = False
    registered: bool = True
    even: bool = True
    similarity: tuple[_Shift, _Shift, _Turn, _Size] = (0.0, 0.0, 0.0, 0.0)
    falloff: Annotated[tuple[Annotated[tuple[Share, ...], STEPS], ...], Field(max_length=3)] = ()

    def __post_init__(self) -> None:
        check_fields(self, "blur law")
        if len(self.falloff) == 2:
            raise InputError("two curves of fall-off, not one, or three of RGB", where="falloff")

    @property
    def levels(self) -> int:
        """The number of depth levels."""
        return len(self.sigmas)

    def depth_of_level(self, level: Any) -> Any:
        """Return the depth level of a blur level: in a law the two are the same."""
        return level

    def kernels(self) -> Floats:
        """Return the 2-D kernel of each depth level, (levels, kernel_size, kernel_size)."""
        return self._kernels

    @cached_property
    def _kernels(self) -> Floats:
        sigmas = np.array(self.sigmas, np.float64)
        kernels = point_spread_functions(sigmas, self.kernel_size, self.exponent)
        kernels.flags.writeable = False
        return kernels

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name, fit for JSON and TOML."""
        listed: dict[str, Any] = to_jsonable_python(asdict(self))
        return listed

    def as_toml(self) -> str:
        """Return the law as TOML, for ``--param recipe=FILE.toml``.

        Examples
        --------
        >>> print(BlurLaw(sigmas=(1.0, 0.5), noise=(0.25,)).as_toml().splitlines()[0])
        sigmas = [1.0, 0.5]
        """
        return toml_text(self.as_dict())


def law_of_fields(given: Mapping[str, Any]) -> BlurLaw:
    """Return a law from its fields by name.

    Raises
    ------
    InputError
        If a field is unknown, of the wrong type or out of range, or `sigmas` is missing.

    Examples
    --------
    >>> law_of_fields({"sigmas": [1.0, 0.5]}).levels
    2
    """
    return made_of(BlurLaw, {name: _tupled(v) for name, v in given.items()}, "blur law")


def _tupled(value: Any) -> Any:
    return tuple(map(_tupled, value)) if isinstance(value, list) else value


def noise_at(noise: ArrayLike, grey: NDArray[Any]) -> Floats:
    """Return a law's noise at some grey levels.

    Examples
    --------
    >>> noise_at((1.0, 3.0), np.array([0, 127.5, 255])).tolist()
    [1.0, 2.0, 3.0]
    """
    values = np.asarray(noise, np.float64)
    return np.asarray(np.interp(grey, np.linspace(0, LAST_LEVEL, values.size), values))
