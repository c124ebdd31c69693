"""Make both images of a pair by a track's formation, and express that formation as a law."""

import dataclasses
import hashlib
import json
import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.law import ROUNDING_VARIANCE, BlurLaw
from dfdbench.blur.light import LINEAR, Floats, Image, decode, encode, photographed
from dfdbench.blur.occlusion import composite_layers, without_tails
from dfdbench.blur.point_spread import point_spread_functions
from dfdbench.blur.recipe import LAST_LEVEL, LEVELS, BlurRecipe
from dfdbench.blur.synthesis import Ints, blur_by_level, blur_by_recipe, require_images, rounded
from dfdbench.blur.tracks import Degradation, Formation
from dfdbench.system.compiled import compiled

# Each 64-bit word of the generator gives two 32-bit numbers.
_HALVES = 2
_STEPS = 2.0**32


def uniform_numbers(count: int, *key: str | int) -> Floats:
    """Return numbers strictly between 0 and 1, always the same for the same key.

    Parameters
    ----------
    count : int
        How many.
    key : str or int
        What the numbers are for; a different key gives different numbers.

    Notes
    -----
    Only the generator's raw bits are used: Philox 4 x 64, which is counter-based, with the first
    128 bits of the key's SHA-256 as its key. NumPy guarantees that these bits never change, but not
    what its distributions make of them.

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


def normal_numbers(shape: tuple[int, ...], *key: str | int) -> Floats:
    """Return standard normal numbers, always the same for the same key.

    Parameters
    ----------
    shape : tuple of int
        The shape of the array.
    key : str or int
        As for `uniform_numbers`.

    Notes
    -----
    The inverse of the normal distribution function at uniform numbers: a fixed formula that uses
    one uniform number for each normal one. The last bit may differ between platforms, which changes
    a grey level once in a trillion pixels.

    Examples
    --------
    >>> normal_numbers((2, 2), "camera", 1).round(2).tolist()
    [[1.48, 2.8], [0.7, -2.09]]
    """
    # Imported here because it takes a third of a second, and running a method needs no noise.
    from scipy.special import ndtri

    return np.asarray(ndtri(uniform_numbers(int(np.prod(shape)), *key)).reshape(shape))


def given_law(recipe: BlurRecipe, formation: Formation) -> BlurLaw:
    """Express a track's formation as a blur law, as far as a law can.

    Parameters
    ----------
    recipe : BlurRecipe
        The data set's recipe.
    formation : Formation
        How the track departs from it.

    Returns
    -------
    BlurLaw
        The true width at every depth level, the kernel's shape and the noise at every grey level;
        whether light is linear, and whether pairs are shifted and change in brightness.

    Notes
    -----
    A law leaves out four things: how far each pair is shifted and how much its brightness changes
    (it only says that they are); that surfaces occlude each other; and that colours focus at
    different depths. It gives the noise's standard deviation at a grey level, rounding included,
    but not the clipping of images to 0 and 255.

    Examples
    --------
    >>> from dfdbench.blur.recipe import RECIPES
    >>> from dfdbench.blur.tracks import find_degradation
    >>> law = given_law(RECIPES["published"], find_degradation("psf-3").formation)
    >>> law.exponent, round(law.sigmas[255], 5), round(law.sigmas[0], 5)
    (32.0, 0.32, 3.18875)
    """
    own = law_of(recipe, formation)
    depths = np.arange(own.levels)
    dark, (second, fourth) = any(formation.falloff), formation.falloff
    square = np.linspace(0, 1, _KNOTS)
    noisy = bool(formation.noise or formation.read_noise or formation.full_well)
    return BlurLaw(
        sigmas=tuple(float(sigma) for sigma in own.sigmas[own.level_of_depth(depths)]),
        exponent=formation.exponent,
        kernel_size=kernel_size_of(own, formation.layers),
        noise=tuple(map(float, _noise(formation))) if noisy else (ROUNDING_VARIANCE**0.5,),
        # Both images go through the same sensor.
        infocus_noise=float(noisy),
        linear=formation.linear,
        registered=not formation.shift,
        even=not formation.gain,
        similarity=(0.0, 0.0, 0.0, formation.magnification),
        falloff=(tuple((1 - second * square - fourth * square**2).tolist()),) * 3 if dark else (),
    )


def _noise(formation: Formation) -> Floats:
    """Return the noise's standard deviation at each grey level, in a law's unit: shape (256,)."""
    if not formation.linear:
        return np.full(LEVELS, math.sqrt(formation.noise**2 + ROUNDING_VARIANCE))
    variance = np.full(LEVELS, formation.read_noise**2)
    if formation.full_well:
        variance += LINEAR / formation.full_well
    # How much light a grey level spans depends on the slope of the camera's curve.
    variance += ROUNDING_VARIANCE * np.square(np.gradient(LINEAR))
    return np.asarray(LAST_LEVEL * np.sqrt(variance), np.float64)


Images = tuple[Image, Image]

# A wide Gaussian's kernel reaches this many sigmas before its tails are cut.
_REACH = 4
#: Lobes of the interpolating kernel that shifts an image; its reach in pixels.
LOBES = 4
# Knots of a law's fall-off curve.
_KNOTS = 9
# How far red, green and blue are out of focus, as fractions of a formation's longitudinal error.
_FARTHER = (1.0, 0.0, 0.7)
_GAUSSIAN = 2


def form_pair(
    infocus: Image, depth: Image, recipe: BlurRecipe, degradation: Degradation, pair: str
) -> Images:
    """Return the in-focus and the defocus image of a pair on a track.

    Parameters
    ----------
    infocus : ndarray of uint8, shape (y, x, channel)
        The data set's own in-focus image, RGB.
    depth : ndarray of uint8, shape (y, x)
        Depth levels, brighter for nearer.
    recipe : BlurRecipe
        The data set's recipe, from which the track departs.
    degradation : Degradation
        The track and its severity; 0 gives the clean pair.
    pair : str
        The pair's name, which seeds everything that is drawn at random.

    Returns
    -------
    infocus, defocus : ndarray of uint8, shape (y, x, channel)

    Raises
    ------
    InputError
        As `dfdbench.blur.synthesis.synthesize` does.

    Notes
    -----
    The steps, each taken only if the formation asks for it: decode to linear light; blur, channel
    by channel if colours focus at different depths; magnify; darken the defocus image's corners,
    always in linear light; shift it; change its gain; add noise to both images; encode; round.
    The random direction, gain and noise are the same at every severity; only their size grows.

    Examples
    --------
    >>> from dfdbench.blur.recipe import RECIPES
    >>> from dfdbench.blur.tracks import find_degradation
    >>> image, depth = np.full((9, 9, 3), 100, np.uint8), np.zeros((9, 9), np.uint8)
    >>> gain = find_degradation("gain-3")
    >>> infocus, defocus = form_pair(image, depth, RECIPES["published"], gain, "Art/view1")
    >>> int(infocus[4, 4, 0]), int(defocus[4, 4, 0])
    (100, 97)
    """
    require_images(infocus, depth, recipe)
    formation = degradation.formation
    key = (degradation.track.name, degradation.track.version, pair)
    light = LINEAR[infocus] if formation.linear else infocus.astype(np.float64)
    blurred = blur(light, depth, recipe, formation)
    larger, lateral = formation.magnification, formation.lateral * np.array([1, 0, -1])
    if larger or formation.lateral:
        light = magnify(light, lateral)
        blurred = magnify(blurred, (1 + lateral) * (1 + larger) - 1)
    if any(formation.falloff):
        blurred = _darkened(blurred, formation)
    if formation.shift:
        turn = 2 * np.pi * uniform_numbers(1, *key, "direction")[0]
        blurred = move(blurred, formation.shift * np.sin(turn), formation.shift * np.cos(turn))
    if formation.gain:
        blurred *= 1 + formation.gain * (2 * uniform_numbers(1, *key, "gain")[0] - 1)
    first = _photograph(light, formation, (*key, "infocus"))
    return first, _photograph(blurred, formation, (*key, "defocus"))


def focus_levels(planes: int) -> tuple[int, ...]:
    """Return the depth levels that a stack's images are focused at, the farthest first.

    Examples
    --------
    >>> focus_levels(5), focus_levels(1)
    ((0, 64, 128, 191, 255), (128,))
    """
    if planes == 1:
        return (LEVELS // 2,)
    return tuple(round(LAST_LEVEL * plane / (planes - 1)) for plane in range(planes))


def form_stack(infocus: Image, depth: Image, recipe: BlurRecipe, planes: int) -> Image:
    """Return the images of a focal stack, shape (image, y, x, channel).

    Parameters
    ----------
    infocus : ndarray of uint8, shape (y, x, channel)
        RGB.
    depth : ndarray of uint8, shape (y, x)
        Depth levels, brighter for nearer.
    recipe : BlurRecipe
        How much blur each level away from the focus adds.
    planes : int
        The number of images; they are focused at `focus_levels`.

    Raises
    ------
    InputError
        As `dfdbench.blur.synthesis.synthesize` does.

    Notes
    -----
    At depth level d an image focused at level f is blurred by a Gaussian with ``sigma = sigma_min +
    |d - f| * sigma_step``. Surfaces occlude each other as in
    `dfdbench.blur.occlusion.composite_layers`.

    Examples
    --------
    >>> from dfdbench.blur.recipe import RECIPES
    >>> image = np.zeros((9, 9, 3), np.uint8)
    >>> image[4, 4] = 255
    >>> stack = form_stack(image, np.full((9, 9), 255, np.uint8), RECIPES["published"], 3)
    >>> stack[:, 4, 4, 0].tolist()
    [4, 13, 248]
    """
    require_images(infocus, depth, recipe)
    light = infocus.astype(np.float64)
    kernels = (_kernels_at(recipe, focus) for focus in focus_levels(planes))
    return np.stack([rounded(composite_layers(light, depth, each)) for each in kernels])


@lru_cache(maxsize=16)
def _kernels_at(recipe: BlurRecipe, focus: int) -> Floats:
    away = np.abs(np.arange(LEVELS) - focus)
    size = kernel_size_of(recipe, layers=True)
    return without_tails(point_spread_functions(recipe.sigmas[away], size, _GAUSSIAN))


def blur(light: Floats, depth: Image, recipe: BlurRecipe, formation: Formation) -> Floats:
    """Blur an image by its depth map as a formation says, keeping its unit and without rounding.

    Parameters
    ----------
    light : ndarray of float64, shape (y, x, channel)
        The in-focus image.
    depth : ndarray of uint8, shape (y, x)
        Depth levels, brighter for nearer.
    recipe : BlurRecipe
        The data set's recipe.
    formation : Formation
        How the blur departs from it.
    """
    if formation.longitudinal:
        each = dataclasses.replace(formation, longitudinal=0.0)
        channels = []
        for channel, share in zip(np.split(light, len(_FARTHER), axis=-1), _FARTHER, strict=True):
            least = recipe.sigma_min + share * formation.longitudinal * recipe.sigma_step
            farther = dataclasses.replace(recipe, sigma_min=least)
            channels.append(blur(channel, depth, farther, each))
        return np.concatenate(channels, axis=-1)
    own = law_of(recipe, formation)
    if formation.exponent == _GAUSSIAN and not formation.layers:
        return blur_by_recipe(light, depth, own)
    kernels = _kernels_by_depth(own, formation.exponent, formation.layers)
    return (composite_layers if formation.layers else blur_by_level)(light, depth, kernels)


def _darkened(image: Floats, formation: Formation) -> Floats:
    y, x = (np.linspace(-1, 1, size) * size for size in image.shape[:2])
    square = (y[:, np.newaxis] ** 2 + x**2) / (image.shape[0] ** 2 + image.shape[1] ** 2)
    second, fourth = formation.falloff
    left = (1 - second * square - fourth * square**2)[..., np.newaxis]
    return image * left if formation.linear else encode(decode(image) * left)


def law_of(recipe: BlurRecipe, formation: Formation) -> BlurRecipe:
    """Return the blur law of a formation: the recipe, multiplied by the formation's factors.

    Examples
    --------
    >>> from dfdbench.blur.recipe import RECIPES
    >>> law_of(RECIPES["published"], Formation(sigma_min=2, sigma_step=2)).sigma_step
    0.0225
    """
    return dataclasses.replace(
        recipe,
        sigma_min=recipe.sigma_min * formation.sigma_min,
        sigma_step=recipe.sigma_step * formation.sigma_step,
    )


def kernel_size_of(law: BlurRecipe, layers: bool) -> int:
    """Return the side of the square kernels: the recipe's or, for layers, enough for the widest.

    Examples
    --------
    >>> from dfdbench.blur.recipe import RECIPES
    >>> kernel_size_of(RECIPES["published"], layers=False)
    27
    """
    return 2 * int(np.ceil(_REACH * law.sigmas.max())) + 1 if layers else law.kernel_size


def move(image: Floats, down: float, right: float) -> Floats:
    """Return an image shifted by fractions of a pixel, by a windowed sinc (Lanczos, four lobes).

    Parameters
    ----------
    image : ndarray of float64, shape (y, x, channel)
        Its edge pixel is repeated past the border.
    down, right : float
        How far, in pixels; a few at most.

    Examples
    --------
    >>> image = np.zeros((1, 9, 1))
    >>> image[0, 4] = 1
    >>> int(move(image, 0, 1)[0, :, 0].argmax())
    5
    """
    # Imported here because it takes half a second, and most runs shift nothing.
    from scipy.ndimage import correlate1d

    for axis, distance in enumerate((down, right)):
        extent = LOBES + int(np.ceil(abs(distance)))
        offsets = np.arange(-extent, extent + 1) + distance
        taps = _lanczos(offsets)
        image = correlate1d(image, taps / taps.sum(), axis=axis, mode="nearest")
    return image


def magnify(image: Floats, larger: Sequence[float] | Floats) -> Floats:
    """Return an image with its channels magnified about the middle, interpolated as in `move`.

    Parameters
    ----------
    image : ndarray of float64, shape (y, x, channel)
        Its edge pixel is repeated past the border.
    larger : sequence of float
        How much larger each channel becomes, 0.006 for 0.6 %.

    Examples
    --------
    >>> image = np.zeros((1, 201, 1))
    >>> image[0, 150] = 1
    >>> int(magnify(image, [0.02])[0, :, 0].argmax())
    151
    """
    out = image.copy()
    for channel, share in enumerate(larger):
        if share:
            # Rows, then columns as rows.
            plane = np.ascontiguousarray(image[..., channel])
            for size in image.shape[:2]:
                rows = _weighted_rows(plane, *_magnifying(size, float(share)))
                plane = np.ascontiguousarray(rows.T)
            out[..., channel] = plane
    return out


def _lanczos(offsets: NDArray[np.floating]) -> Floats:
    within = np.abs(offsets) < LOBES
    return np.where(within, np.sinc(offsets) * np.sinc(offsets / LOBES), 0)


@lru_cache(maxsize=16)
def _magnifying(size: int, larger: float) -> tuple[Ints, Floats]:
    """Return the nearest row to each row's place, and the weights of the rows around that."""
    middle = (size - 1) / 2
    places = middle + (np.arange(size) - middle) / (1 + larger)
    nearest = np.rint(places).astype(int)
    steps = np.arange(-LOBES, LOBES + 1)
    offsets = (nearest - places)[:, np.newaxis] + steps
    taps = _lanczos(offsets)
    return nearest, taps / taps.sum(axis=1, keepdims=True)


@compiled()
def _weighted_rows(plane: Floats, nearest: Ints, taps: Floats) -> Floats:
    height, width = plane.shape
    out = np.zeros_like(plane)
    for y in range(height):
        for step in range(taps.shape[1]):
            row, weight = min(max(nearest[y] + step - LOBES, 0), height - 1), taps[y, step]
            for x in range(width):
                out[y, x] += weight * plane[row, x]
    return out


def _photograph(light: Floats, formation: Formation, key: tuple[str | int, ...]) -> Image:
    variance = np.array(formation.noise**2 + formation.read_noise**2)
    if formation.full_well:
        # The Poisson noise of many electrons is Gaussian; its variance is their number.
        variance = variance + np.maximum(light, 0) / formation.full_well
    if variance.any():
        light = light + np.sqrt(variance) * normal_numbers(light.shape, *key)
    return photographed(light) if formation.linear else rounded(light)


@lru_cache(maxsize=8)
def _kernels_by_depth(law: BlurRecipe, exponent: float, layers: bool) -> Floats:
    kernels = point_spread_functions(law.sigmas, kernel_size_of(law, layers), exponent)
    kernels = without_tails(kernels) if layers else kernels
    return np.asarray(kernels[np.asarray(law.level_of_depth(np.arange(law.levels)))])
