"""The methods ``dfd-net`` and ``u-net``: trained networks; needs the extra ``nets``."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.recipe import LEVELS
from dfdbench.errors import MethodError
from dfdbench.methods.edges import lent_within_edges
from dfdbench.methods.fitted import Image, number_within, wrong
from dfdbench.methods.networks.inference import Precision, Predictor, Readout, find_device
from dfdbench.methods.networks.weights import open_weights
from dfdbench.methods.readout import read_out
from dfdbench.methods.wls import measured

_THESIS = "Emerson, Purdue 2019, doi 10.25394/PGS.8938376, chapter 5"
# How texture is measured, and what ends a vote at edges: what `wls` tries second, and its default.
_SMOOTHING, _WINDOW, _CONTRAST = 1.0, 15, 3.0
# Parts of the depth range that are smoothed at once, and rows that are read at once.
_TOGETHER, _ROWS = 4, 128


class _Learned:
    method: str
    paper: str
    #: What `dfdbench.tune` tries.
    ranges: ClassVar[dict[str, Sequence[float]]] = {"strength": (0.0, 1e2, 1e3, 1e4, 1e5)}

    def __init__(
        self,
        weights: str | Path | None = None,
        recipe_name: str | None = None,
        device: str = "auto",
        precision: Precision = "float32",
        tile: int | None = None,
        readout: Readout | None = None,
        strength: float = 0.0,
        orientations: int = 1,
    ) -> None:
        problems = number_within("strength", strength, 1e9, zero=True)
        if type(orientations) is not int or orientations not in (1, 8):
            problems.append(wrong("orientations", "1 or 8", orientations))
        MethodError.raise_if(problems)
        self._strength, self._orientations = float(strength), orientations
        #: Kept in results: the same name may hold other weights tomorrow.
        network, self.card, self.weights_sha256 = open_weights(self.method, weights)
        if readout is None:
            readout = self.card.configuration.get("readout", "mode")
        self._predict = Predictor(network, find_device(device), precision, tile, readout)
        self.trained_on = self.card.saw
        #: What a result is to say.
        self.warnings: list[str] = []
        # Trained on random tracks, it has seen more blurs than one.
        one_blur = not self.card.configuration.get("tracks")
        if one_blur and recipe_name is not None and recipe_name != self.card.recipe:
            known, here = _blur(self.card.recipe), _blur(recipe_name)
            self.warnings.append(f"trained on {known}, run on {here}")

    def __call__(self, infocus: Image, defocus: Image) -> NDArray[np.float32]:
        """Return depth levels for two RGB images of uint8, shape (y, x, 3)."""
        if not self._strength:
            return self._mean(self._predict, infocus, defocus)
        # Each pixel's votes, as log-probabilities.
        votes = np.moveaxis(self._mean(self._predict.log_shares, infocus, defocus), 2, 0)
        weight = measured(infocus, defocus, _SMOOTHING, _WINDOW)[1]
        for first in range(0, len(votes), _TOGETHER):
            some = slice(first, first + _TOGETHER)
            by = weight, infocus, self._strength, _CONTRAST
            votes[some] = lent_within_edges(votes[some], *by)
        part = LEVELS / len(votes)
        levels = np.empty(infocus.shape[:2], np.float32)
        for top in range(0, len(levels), _ROWS):
            rows = slice(top, top + _ROWS)
            levels[rows] = (read_out(-votes[:, rows], sharpness=1) + 0.5) * part - 0.5
        return levels

    def _mean(
        self, predict: Callable[[Image, Image], NDArray[Any]], infocus: Image, defocus: Image
    ) -> NDArray[np.float32]:
        """Return the mean answer over orientations, float32."""
        answers = (
            _turned_back(predict(*(_turned(image, turn) for image in (infocus, defocus))), turn)
            for turn in range(self._orientations)
        )
        total = np.array(next(answers), np.float32)
        for answer in answers:
            total += answer
        total /= np.float32(self._orientations)
        return total

    def warm_up(self, infocus: Image, defocus: Image) -> None:
        """Let the libraries choose their kernels, and compile, before anything is timed."""
        self._predict(infocus, defocus)
        if self._strength:
            self(infocus[:32, :32].copy(), defocus[:32, :32].copy())


class DfDNetMethod(_Learned):
    """Depth by DfD-Net, the thesis's network, with weights that were trained before.

    Parameters
    ----------
    weights : str or Path
        A file that ``dfdbench train`` wrote, or the name of shipped weights.
    recipe_name : str, optional
        Of the blur of the images; in a run, the data set's. A result warns where it is not the
        one that the network was trained on.
    device : str
        ``cpu``, ``cuda``, ``mps``, or ``auto`` for the fastest that there is.
    precision : {"float32", "bf16"}
        ``bf16`` is faster on processors that have it. Levels differ in many pixels, mean scores
        little.
    tile : int, optional
        Cut images into tiles of this many rows and columns; by default as large as 400 MB hold.
    readout : {"mode", "median"}, optional
        Which level of a pixel's distribution over all levels is the answer: the likeliest, as in
        the thesis, or its median. By default what the weights were made for; the median where
        pixels vote.
    strength : float
        How much pixels vote with their neighbours, as far as the in-focus image's edges: their
        log-probabilities are smoothed `within_edges`, more texture counting more, as by `wls`, and
        the answer is the median of their mean. 0, the thesis's way, leaves each pixel to itself. A
        network looks at less than most surfaces are large, so 10,000 helps where blur is measured
        badly, as in noise, and does harm where it is measured well.
    orientations : {1, 8}
        8 gives the mean of the answers for the pair turned by quarters and mirrored, as training
        shows patches: each answer errs a little differently. It takes eight times as long.

    Raises
    ------
    MethodError
        Where the weights are absent, damaged, or of another architecture, or a number is none of
        those above.

    Notes
    -----
    The mean over orientations is the "enhanced prediction" of Timofte, Rothe and Van Gool, "Seven
    ways to improve example-based single image super resolution", CVPR 2016.

    Examples
    --------
    >>> image = np.zeros((30, 41, 3), np.uint8)
    >>> DfDNetMethod(weights="demo", device="cpu")(image, image).shape
    (30, 41)
    """

    method = "dfd-net"
    paper = _THESIS


class UNetMethod(_Learned):
    """Depth by U-Net; parameters are those of `DfDNetMethod`.

    Examples
    --------
    >>> image = np.zeros((30, 41, 3), np.uint8)
    >>> UNetMethod(weights="demo", device="cpu")(image, image).shape
    (30, 41)
    """

    method = "u-net"
    paper = "Ronneberger et al., MICCAI 2015, doi 10.1007/978-3-319-24574-4_28; " + _THESIS


def _turned(image: Image, orientation: int) -> Image:
    # Orientations 4 to 7 are mirror images.
    turned = np.rot90(image, orientation % 4)
    return np.ascontiguousarray(turned[:, ::-1] if orientation >= 4 else turned)


def _turned_back(levels: NDArray[Any], orientation: int) -> NDArray[Any]:
    return np.rot90(levels[:, ::-1] if orientation >= 4 else levels, -(orientation % 4))


def _blur(recipe: str) -> str:
    return f"the blur recipe {recipe}" if recipe else "captured defocus"
