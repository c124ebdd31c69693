"""Try a method on awkward inputs before an hour is spent on a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.methods.calling import call
from dfdbench.methods.method import Method
from dfdbench.metrics.scores import AGAINST, correlation

Image = NDArray[np.uint8]

_ORDINARY = "an ordinary pair, 240 × 320"


@dataclass(frozen=True)
class Check:
    """One input that was tried: what it was, what was wrong (empty: nothing), what was odd."""

    name: str
    seconds: float
    error: str
    warning: str


def check_method(method: Method, seed: int = 0) -> tuple[Check, ...]:
    """Call a method on awkward pairs and say what is wrong with its answers.

    Tried are odd sizes, tall and wide images, a flat, a black and a saturated pair, a pair
    without any blur; the same pair twice (the answers must be equal); whether the method
    writes into the images it is handed; and whether its depth is brighter for nearer, which
    shows on a slope whose near side is less blurred.

    Parameters
    ----------
    method : Method
        From `dfdbench.methods.registry.load_method`.
    seed : int
        Of the images.
    """
    pairs = _awkward_pairs(seed)
    if method.warm_up:
        call(method.warm_up, *pairs[_ORDINARY])
    trials = []
    for name, (infocus, defocus) in pairs.items():
        prediction = call(method.predict, infocus, defocus)
        warning = "printed to standard output" if prediction.printed else ""
        trials.append(Check(name, prediction.seconds, prediction.error, warning))
    infocus, defocus = pairs[_ORDINARY]
    first = call(method.predict, infocus, defocus)
    second = call(method.predict, infocus, defocus)
    if first.depth is not None and second.depth is not None:
        odd = ""
        if not np.array_equal(first.depth, second.depth):
            odd = "two answers to one pair differ: fix its seeds, or its scores cannot be rerun"
        trials.append(Check("the same pair twice", second.seconds, "", odd))
        likeness = correlation(_slope(*first.depth.shape), first.depth)
        turned = "depth seems to grow with distance: every set wants brighter for nearer"
        odd = turned if likeness < AGAINST else ""
        trials.append(Check("brighter for nearer", first.seconds, "", odd))
    trials.append(_try_writing(method, infocus, defocus))
    return tuple(trials)


def _awkward_pairs(seed: int) -> dict[str, tuple[Image, Image]]:
    random = np.random.default_rng(seed)
    recipe = RECIPES["published"]

    def noise(height: int, width: int) -> tuple[Image, Image]:
        image = random.integers(0, 256, (height, width, 3)).astype(np.uint8)
        return image, synthesize(image, _slope(height, width), recipe)

    def flat(value: int) -> tuple[Image, Image]:
        image = np.full((120, 160, 3), value, np.uint8)
        return image, image.copy()

    sharp = noise(120, 160)[0]
    return {
        _ORDINARY: noise(240, 320),
        "odd sizes, 241 × 317": noise(241, 317),
        "a tall image, 200 × 60": noise(200, 60),
        "a wide image, 60 × 200": noise(60, 200),
        "a small image, 33 × 47": noise(33, 47),
        "a black pair": flat(0),
        "a flat grey pair": flat(128),
        "a saturated pair": flat(255),
        "a pair without blur": (sharp, sharp.copy()),
    }


def _slope(height: int, width: int) -> Image:
    levels = np.linspace(40, 220, width).astype(np.uint8)
    return np.broadcast_to(levels, (height, width)).copy()


def _try_writing(method: Method, infocus: Image, defocus: Image) -> Check:
    # `call` hands out copies, so nothing is spoilt; still a method that writes is a trap.
    mine = infocus.copy(), defocus.copy()

    def predict(_: Image, __: Image) -> object:
        returned: object = method.predict(*mine)
        return returned

    prediction = call(predict, infocus, defocus)
    same = np.array_equal(mine[0], infocus) and np.array_equal(mine[1], defocus)
    warning = "" if same else "changes the images it is handed"
    return Check("leaves its input alone", prediction.seconds, prediction.error, warning)
