"""Ask whether the residual of a blurred image ranks methods as the truth does.

    python docs/certificate.py dfd-indoor

Methods get red, blue and their mean, of eight test captures, fitted on 24 of training. From each
depth map and the green in-focus image the law fitted to green predicts the green defocus image.
Printed are each method's NRMSE, the residual's root mean square in units of the law's noise, the
residual of the true depth, and the rank correlation over methods, also with the error of the blur's
width, since two depths may have one. Behind the data set's name may
stand names of methods, from the list below.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from dfdbench.blur.law import BlurLaw
from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.evaluation.fitting import training_pairs
from dfdbench.evaluation.loading import load_for
from dfdbench.methods.blurred import blurred_by
from dfdbench.methods.calibration import calibrate
from dfdbench.methods.fitted import evenly_spread
from dfdbench.methods.method import teach

TRAIN, TEST = 24, 8
# Kernels reach so far past the border.
BORDER = 13
# Windows are named, so that a fit does not try many.
FIXED = {"window": 7, "prior": False}
METHODS: dict[str, tuple[str, dict[str, Any]]] = {
    "constant": ("constant", {}),
    "constant-median": ("dfdbench.methods.baselines:ConstantMedian", {}),
    "positional-prior": ("positional-prior", {}),
    "s-transform": ("s-transform", {}),
    "s-transform-wide": ("s-transform", {"smoothing": 0.5, "window": 91}),
    "local": ("local", FIXED),
    "local-21": ("local", {**FIXED, "window": 21}),
    "guided": ("guided", FIXED),
    "sgm": ("sgm", {"prior": False}),
    "graph-cuts": ("graph-cuts", {"prior": False}),
    "rational-filters": ("rational-filters", FIXED),
    "favaro-soatto": ("favaro-soatto", FIXED),
    "dfd-net-dfd-indoor": ("dfd-net", {"weights": "dfd-indoor"}),
    "dfd-net-middlebury": ("dfd-net", {"weights": "middlebury"}),
    "dfd-net-demo-median": ("dfd-net", {"weights": "demo", "readout": "median"}),
    "u-net-demo": ("u-net", {"weights": "demo"}),
}


def without_green(capture: Capture) -> Capture:
    """Return a capture whose green is the mean of red and blue."""
    images = capture.images.copy()
    images[..., 1] = images[..., [0, 2]].mean(axis=-1).round()
    return replace(capture, images=images)


def residual(law: BlurLaw, capture: Capture, depth: NDArray[Any]) -> float:
    """Return what a depth map leaves of green where depth is known, in units of the noise."""
    blurred = blurred_by(law, capture.infocus, capture.defocus)
    level = np.clip(depth, 0, 255)
    below = np.minimum(level.astype(np.intp), 254)
    part = (level - below)[..., np.newaxis]
    factors = (1 - part) * blurred.factors.T[below] + part * blurred.factors.T[below + 1]
    left = (blurred.nodes[:, :, 1] * factors).sum(axis=2) - blurred.aim[..., 1]
    squares = np.square(left / blurred.noise[..., 1]) / blurred.spread[below]
    inner = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    return float(np.sqrt(squares[inner][capture.valid[inner]].mean()))


def nrmse(capture: Capture, depth: NDArray[Any]) -> float:
    """Return the error of a depth map under protocol `valid`."""
    off = (depth - capture.levels.astype(np.float64))[capture.valid]
    return float(np.sqrt(np.square(off).mean())) / 255


def width_error(law: BlurLaw, capture: Capture, depth: NDArray[Any]) -> float:
    """Return by how much a depth map's blur is off, in pixels of standard deviation."""
    widths = np.interp(depth, np.arange(law.levels), law.sigmas)
    off = (widths - np.array(law.sigmas)[capture.levels])[capture.valid]
    return float(np.sqrt(np.square(off).mean()))


def depth_maps(
    store: Dataset, name: str, train: Sequence[Capture], test: Sequence[Capture]
) -> list[NDArray[Any]]:
    """Return a method's depth maps of captures without green."""
    entry, parameters = METHODS[name]
    method = load_for(store, entry, parameters)
    if method.learner is not None:
        teach(method, [without_green(capture) for capture in train])
    unseen = map(without_green, test)
    return [np.asarray(method(c.infocus, c.defocus), np.float64) for c in unseen]


def main(dataset: str, *names: str) -> None:
    """Print the table and the rank correlation."""
    store = open_dataset(dataset)
    of_training = training_pairs(store, "test")[1]
    train = [of_training[index] for index in evenly_spread(len(of_training), TRAIN)]
    of_test = store.captures("test")
    test = [of_test[index] for index in evenly_spread(len(of_test), TEST)]
    law = calibrate(train).law
    found = {"truth": [capture.levels.astype(np.float64) for capture in test]}
    found |= {name: depth_maps(store, name, train, test) for name in names or METHODS}
    measures = (nrmse, partial(residual, law), partial(width_error, law))
    rows = {
        name: [
            float(np.mean([measure(c, depth) for c, depth in zip(test, maps, strict=True)]))
            for measure in measures
        ]
        for name, maps in found.items()
    }
    print("| method | NRMSE | residual |\n|:---|---:|---:|")
    for name, (error, left, _) in sorted(rows.items(), key=lambda row: row[1]):
        print(f"| {name} | {error:.3f} | {left:.2f} |")
    del rows["truth"]
    errors, lefts, widths = zip(*rows.values(), strict=True)
    rank, by_width = (spearmanr(lefts, values).statistic for values in (errors, widths))
    print(f"\nRank correlation over {len(rows)} methods: {rank:.2f}; with blur: {by_width:.2f}.")


if __name__ == "__main__":
    main(*sys.argv[1:])
