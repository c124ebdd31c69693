"""Photographs that ship with scikit-image, and camera noise, for simulated scenes."""

from functools import cache
from pathlib import Path

import numpy as np
import skimage.data
import skimage.io

from dfdbench.blur.light import Floats
from dfdbench.errors import SourceError

GAMMA = 2.2


@cache
def photograph(name: str) -> Floats:
    """Return a photograph as linear reflectance, shape (y, x, 3), 0 to 1.

    Raises
    ------
    SourceError
        If this scikit-image does not ship it.
    """
    path = Path(skimage.data.__file__).parent / f"{name}.png"
    if not path.exists():
        fix = "pip install --force-reinstall scikit-image"
        raise SourceError("a photograph of scikit-image is missing", where=str(path), fix=fix)
    image = skimage.io.imread(path)
    if image.ndim == 2:
        image = np.repeat(image[:, :, np.newaxis], 3, axis=2)
    # The photographs are gamma-encoded, but light is linear.
    table = (np.arange(256) / 255.0) ** GAMMA
    return np.asarray(table[image[:, :, :3]])


def near_normal_numbers(shape: tuple[int, ...], seed: tuple[int, ...]) -> Floats:
    """Return nearly normal numbers, the same ones for a seed in every version of NumPy.

    Only simulated scenes use them. The noise of tracks is another stream, and exactly normal:
    `dfdbench.blur.formation.normal_numbers`.

    Examples
    --------
    >>> abs(near_normal_numbers((1000,), (1,)).std().round(1).item())
    1.0
    """
    # The sum of four 16-bit numbers is close to normal. NumPy promises that this raw stream never
    # changes, unlike its own normal numbers.
    generator = np.random.PCG64(np.random.SeedSequence(seed))
    raw = np.atleast_1d(generator.random_raw(int(np.prod(shape)))).view(np.uint16)
    total = sum(raw[part::4].astype(np.float64) for part in range(4))
    spread = np.sqrt(4 * (65536.0**2 - 1) / 12)
    return np.asarray((total - 2 * 65535.0) / spread).reshape(shape)
