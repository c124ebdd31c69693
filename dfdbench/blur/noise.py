"""Random numbers that any platform repeats, named by what they are for."""

from __future__ import annotations

import hashlib
import json

import numpy as np
from numpy.typing import NDArray

# A generator's 64 bits make two numbers of 32.
_HALVES = 2
_STEPS = 2.0**32


def uniform_numbers(count: int, *key: str | int) -> NDArray[np.float64]:
    """Return numbers between 0 and 1, both left out, the same for the same key.

    Parameters
    ----------
    count : int
        How many.
    key : str or int
        What they are for; another key gives others.

    Notes
    -----
    Of a generator only the raw bits are used: Philox 4 x 64, which counts instead of remembering,
    under the first 128 bits of the key's SHA-256. NumPy keeps these bits for good, but not what its
    distributions make of them.

    Examples
    --------
    >>> uniform_numbers(2, "camera", "Art/view1").round(4).tolist()
    [0.2311, 0.9622]
    """
    digest = hashlib.sha256(json.dumps(key).encode()).digest()
    generator = np.random.Philox(key=int.from_bytes(digest[:16], "little"))
    bits = np.atleast_1d(generator.random_raw(-(-count // _HALVES)))
    halves = bits.astype("<u8").view("<u4")[:count]
    return np.asarray((halves + 0.5) / _STEPS, dtype=np.float64)


def normal_numbers(shape: tuple[int, ...], *key: str | int) -> NDArray[np.float64]:
    """Return numbers of the standard normal distribution, the same for the same key.

    Parameters
    ----------
    shape : tuple of int
        Of the array.
    key : str or int
        As for `uniform_numbers`.

    Notes
    -----
    The inverse of the normal distribution function at uniform numbers: a fixed formula, a number
    of random bits for a number of noise. The last bit may be another on another platform, which a
    grey level shows once in a trillion pixels.

    Examples
    --------
    >>> normal_numbers((2, 2), "camera", 1).round(2).tolist()
    [[1.48, 2.8], [0.7, -2.09]]
    """
    # Here: it takes a third of a second, and who only runs a method makes no noise.
    from scipy.special import ndtri

    return np.asarray(ndtri(uniform_numbers(int(np.prod(shape)), *key)).reshape(shape))
