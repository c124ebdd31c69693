"""Choose windows on the training scenes of `dfd-indoor`: how two rows of its board came about.

dfdbench build dfd-indoor --source d3net_depth_estimation
python docs/windows.py

`s-transform` is fitted on every second training scene and scored on the others, then the other way
round. The network was trained on all of them; of its depth maps the median over a window is taken.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike

from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import open_dataset
from dfdbench.methods.registry import load
from dfdbench.methods.s_transform import STransform
from dfdbench.metrics.scores import nmae

SMOOTHINGS = (0.5, 1.0, 2.5, 4.0)
WINDOWS = (9, 21, 41, 61, 91, 131)


def main() -> None:
    """Print NMAE under `valid`, a line a method, a column a window."""
    store = open_dataset("dfd-indoor")
    pairs = [store.read(pair) for pair in store.pairs("train")]
    halves = [(pairs[::2], pairs[1::2]), (pairs[1::2], pairs[::2])]
    known = [np.concatenate([pair.depth[pair.valid] for pair in half]) for half, _ in halves]
    for name, middle in (("mean", np.mean), ("median", np.median)):
        scores = [
            error(pair, np.full(pair.depth.shape, middle(depth)))
            for depth, (_, half) in zip(known, halves, strict=True)
            for pair in half
        ]
        print(f"constant at the {name}: {np.mean(scores):.4f}")
    print(f"{'window':27}", " none ", *(f"{window:6}" for window in WINDOWS))
    for smoothing in SMOOTHINGS:
        row = [transform_error(halves, smoothing, window) for window in WINDOWS]
        print(f"s-transform, smoothing {smoothing:<4}", "      ", *(f"{each:.4f}" for each in row))
    network = load("dfd-net", weights="dfd-indoor")
    maps = [network(pair.infocus, pair.defocus).astype(np.uint8) for pair in pairs]
    row = [
        float(np.mean([error(*each) for each in zip(pairs, smooth, strict=True)]))
        for smooth in (maps, *([cv2.medianBlur(m, window) for m in maps] for window in WINDOWS))
    ]
    print("dfd-net, weights=dfd-indoor", *(f"{each:.4f}" for each in row))


def error(pair: Capture, depth: ArrayLike) -> float:
    """Return the mean absolute error over known pixels, as a part of all levels."""
    return nmae(pair.depth, depth, data_range=255, mask=pair.valid)


def transform_error(
    halves: Sequence[tuple[Sequence[Capture], Sequence[Capture]]], smoothing: float, window: int
) -> float:
    """Return the mean error of `s-transform` on scenes that it was not fitted on."""
    scores = []
    for fitted, scored in halves:
        method = STransform(smoothing=smoothing, window=window)
        assert method.fit is not None
        method.restore(dict(method.fit(fitted)))
        scores += [error(pair, method(pair.infocus, pair.defocus)) for pair in scored]
    return float(np.mean(scores))


if __name__ == "__main__":
    main()
