"""Time graph cuts on crops of a pair: python docs/graph_cuts_time.py STORE PAIR OUT.png [REPEATS].

STORE is a built store, PAIR the name of one of its pairs. Prints and draws seconds by pixels, as
the thesis's Fig. 4.4, which has the mean of 30 repeats.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from dfdbench.datasets.dataset import Dataset
from dfdbench.methods.graph_cuts import GraphCuts

SIDES = (0.25, 0.4, 0.55, 0.7, 0.85, 1.0)


def main(store_path: str, name: str, out: str, repeats: str = "3") -> None:
    """Print the times and draw them."""
    store = Dataset(Path(store_path))
    images = store.read(next(pair for pair in store.pairs("all") if pair.id == name))
    assert store.recipe is not None, "graph cuts need a synthetic blur"
    method = GraphCuts(store.recipe)
    rows, columns = images.depth.shape
    # Compiled, and memory taken, before the clock runs.
    method(images.infocus, images.defocus)
    pixels, means, spreads = [], [], []
    for side in SIDES:
        here = slice(0, round(side * rows)), slice(0, round(side * columns))
        infocus, defocus = (
            np.ascontiguousarray(image[here]) for image in (images.infocus, images.defocus)
        )
        taken = []
        for _ in range(int(repeats)):
            begin = time.perf_counter()
            method(infocus, defocus)
            taken.append(time.perf_counter() - begin)
        pixels.append(infocus.shape[0] * infocus.shape[1])
        means.append(float(np.mean(taken)))
        spreads.append(float(np.std(taken)))
        print(f"{pixels[-1]:8,} pixels: {means[-1]:6.3f} s, standard deviation {spreads[-1]:.3f} s")
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axis = figure.subplots()
    axis.errorbar(pixels, means, yerr=spreads, marker="o", capsize=3)
    axis.set(
        title=f"graph-cuts on crops of {name}:\nmean and standard deviation of {repeats}",
        xlabel="pixels", ylabel="seconds", xlim=(0, None), ylim=(0, None),
    )  # fmt: skip
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axis.grid(alpha=0.3)
    figure.savefig(out, dpi=90)


if __name__ == "__main__":
    main(*sys.argv[1:])
