"""The methods ``dfd-net`` and ``u-net``: trained networks; needs the extra ``nets``."""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import MethodError
from dfdbench.methods.fitted import Image, odd_window, wrong
from dfdbench.methods.networks.inference import Precision, Predictor, Readout, find_device
from dfdbench.methods.networks.weights import open_weights

_THESIS = "Emerson, Purdue 2019, doi 10.25394/PGS.8938376, chapter 5"


class _Learned:
    method: str
    paper: str
    #: What `dfdbench.tune` tries.
    ranges: ClassVar[dict[str, Sequence[int]]] = {"median_window": (1, 9, 21, 41, 61, 91)}

    def __init__(
        self,
        weights: str | Path | None = None,
        recipe_name: str | None = None,
        device: str = "auto",
        precision: Precision = "float32",
        tile: int | None = None,
        readout: Readout | None = None,
        median_window: int = 1,
        orientations: int = 1,
    ) -> None:
        problems = odd_window("median_window", median_window)
        if type(orientations) is not int or orientations not in (1, 8):
            problems.append(wrong("orientations", "1 or 8", orientations))
        MethodError.raise_if(problems)
        self._median_window = median_window
        self._orientations = orientations
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
        if self._orientations == 1:
            return self._levels(infocus, defocus)
        total = np.zeros(infocus.shape[:2], np.float32)
        for orientation in range(8):
            pair = (_turned(image, orientation) for image in (infocus, defocus))
            total += _turned_back(self._levels(*pair), orientation)
        return total / np.float32(8)

    def _levels(self, infocus: Image, defocus: Image) -> NDArray[np.float32]:
        levels = self._predict(infocus, defocus)
        if self._median_window > 1:
            levels = np.asarray(cv2.medianBlur(levels, self._median_window))
        return levels.astype(np.float32)

    def warm_up(self, infocus: Image, defocus: Image) -> None:
        """Let the libraries choose their kernels before anything is timed."""
        self._predict(infocus, defocus)


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
        the thesis, or its median. By default what the weights were made for.
    median_window : int
        Side of the square window over which the answer's median is taken, in pixels, odd; 1 leaves
        the answer as it is, as the thesis does. A network looks at less than most surfaces are
        large: in real captures a wide window helps.
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


def _turned_back(levels: NDArray[np.float32], orientation: int) -> NDArray[np.float32]:
    return np.rot90(levels[:, ::-1] if orientation >= 4 else levels, -(orientation % 4))


def _blur(recipe: str) -> str:
    return f"the blur recipe {recipe}" if recipe else "captured defocus"
