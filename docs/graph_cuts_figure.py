"""Say and draw where a run's error lies: python docs/graph_cuts_figure.py STORE RUN [PAIR OUT].

STORE is a built store, RUN the folder of a run on it. Prints each region's share of pixels and of
error; draws PAIR into the picture OUT.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.results.record import RESULT, load_result
from dfdbench.results.run_folder import read_prediction

REGIONS = ("unknown pixels", "near a depth edge", "flat colour", "the rest")


def regions(images: Capture) -> NDArray[np.int64]:
    """Give each pixel the number of its region.

    Unknown; within 2 pixels of a step of more than 3 levels; of 7 × 7 surroundings that span at
    most 12 grey levels in every channel; the rest.
    """
    depth = images.depth.astype(np.int64)
    edge = np.zeros(depth.shape, np.uint8)
    across, down = np.abs(np.diff(depth, axis=1)) > 3, np.abs(np.diff(depth, axis=0)) > 3
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    near = cv2.dilate(edge, np.ones((3, 3))) > 0
    box = np.ones((7, 7))
    span = cv2.dilate(images.infocus, box).astype(int) - cv2.erode(images.infocus, box)
    flat = np.asarray(span).max(axis=2) <= 12
    return np.select([~images.valid, near, flat], [0, 1, 2], 3)


def main(store_path: str, run_path: str, shown_pair: str = "", out: str = "") -> None:
    """Print the table and draw the picture."""
    store, run = Dataset(Path(store_path)), Path(run_path)
    pixels, squared, absolute = np.zeros(4), np.zeros(4), np.zeros(4)
    for record in load_result(run / RESULT).pairs:
        pair = Pair(record.scene, tuple(record.coordinates.items()))
        shape = store.shape_of(pair.scene)
        prediction = read_prediction(run, pair, shape) if record.status == "ok" else None
        if prediction is None:
            continue
        images = store.read(pair)
        error, region = prediction - images.depth.astype(np.float64), regions(images)
        for number in range(4):
            inside = error[region == number]
            pixels[number] += inside.size
            squared[number] += float((inside**2).sum())
            absolute[number] += float(np.abs(inside).sum())
        if record.id == shown_pair:
            figure = Figure(figsize=(13, 3.6), layout="constrained")
            axes = figure.subplots(1, 3)
            axes[0].imshow(images.infocus)
            axes[0].set_title("in-focus")
            colours = axes[1].imshow(region, cmap="cividis", interpolation="nearest")
            axes[1].set_title("region")
            bar = figure.colorbar(colours, ax=axes[1], ticks=range(4), fraction=0.05)
            bar.ax.set_yticklabels(REGIONS)
            shown = axes[2].imshow(error, cmap="PuOr", vmin=-10, vmax=10, interpolation="nearest")
            axes[2].set_title("prediction − truth")
            figure.colorbar(shown, ax=axes[2], label="levels", fraction=0.05, extend="both")
            for axis in axes:
                axis.set_xticks([])
                axis.set_yticks([])
            figure.savefig(out, dpi=90)
    for number, name in enumerate(REGIONS):
        print(
            f"{name:18} {pixels[number] / pixels.sum():6.1%} of pixels, "
            f"{squared[number] / squared.sum():6.1%} of squared and "
            f"{absolute[number] / absolute.sum():6.1%} of absolute error, "
            f"mean {absolute[number] / max(pixels[number], 1):.2f} levels"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
