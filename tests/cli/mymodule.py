"""Methods for the tests of the command line, which finds them in the folder where it is called."""

from typing import Any

import cv2
import numpy as np


def predict(infocus: Any, defocus: Any) -> Any:
    print("predicting")
    return np.full(infocus.shape[:2], 90)


def nan(infocus: Any, defocus: Any) -> Any:
    return np.full(infocus.shape[:2], np.nan)


def dim(infocus: Any, defocus: Any) -> Any:
    if infocus.mean() > 100:
        raise RuntimeError("too bright")
    return predict(infocus, defocus)


def near(infocus: Any, defocus: Any) -> Any:
    return np.full(infocus.shape[:2], 255.0)


def sure(infocus: Any, defocus: Any) -> Any:
    error = np.abs(infocus[..., 0].astype(float) - defocus[..., 0])
    return infocus[..., 0] / 2, 5 + error


def nought(infocus: Any, defocus: Any) -> Any:
    return infocus[..., 0] / 2, np.zeros(infocus.shape[:2])


def gaps(infocus: Any, defocus: Any) -> Any:
    depth = infocus[..., 0] / 2
    depth[:12] = np.nan
    return depth


def sometimes(infocus: Any, defocus: Any) -> Any:
    return gaps(infocus, defocus) if infocus.shape[1] == 31 else infocus[..., 0] / 2


def peak(stack: Any) -> Any:
    sharpness = [cv2.Laplacian(image, cv2.CV_32F).max(2) for image in stack.values[1:]]
    return stack.focus_distance.values[1:][np.argmax(sharpness, 0)].astype(np.float32)


peak.unit = "metres"  # type: ignore[attr-defined]


def first(stack: Any) -> Any:
    return stack.values[0, ..., 0]


class Asking:
    def __init__(self, recipe: Any) -> None: ...

    def __call__(self, infocus: Any, defocus: Any) -> None: ...


class Elsewhere:
    trained_on = "tiny-1, all but K2"

    def __call__(self, infocus: Any, defocus: Any) -> Any:
        # Right wherever the depth is 100, far off elsewhere.
        return np.full(infocus.shape[:2], 100)
