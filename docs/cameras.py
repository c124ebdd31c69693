"""What is a fit worth behind another camera? python docs/cameras.py prints it, from cameras.csv.

`python docs/cameras.py FOLDER` makes that table and its picture: six cameras photograph the same
rooms, and each method is fitted on the training rooms of one camera and tested on the test rooms of
all. FOLDER keeps what is done: the same command goes on after a stop.
"""

from __future__ import annotations

import hashlib
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import dfdbench
from dfdbench.building import SceneImages, build_store
from dfdbench.building.sources import Whole
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.datasets.rendered import GENERATOR, scene_number, unseen_text
from dfdbench.figures.comparisons import OVER_OWN, draw_transfer
from dfdbench.optics.thin_lens import ThinLens
from dfdbench.simulation.lens import Camera
from dfdbench.simulation.unseen import render_pair

TABLE = Path(__file__).with_suffix(".csv")
#: Of the rooms, which no row of the leaderboard has, and how many to fit and to test on.
SEED, ROOMS = 33, 6
SHAPE = (240, 320)
METHODS = ("volume-net", "graph-cuts", "sgm", "rational-filters", "s-transform")
#: What no fit may fall behind: it knows the mean depth of a camera's own rooms.
FLOOR = "constant"


def lens(
    f_number: float = 2.0, focus: float = 0.65, focal_length: float = 0.025, angle: float = 50.0
) -> ThinLens:
    """Return a lens whose image sees so many degrees across."""
    sensor = focal_length * focus / (focus - focal_length)
    pitch = 2 * sensor * math.tan(math.radians(angle) / 2) / SHAPE[1]
    return ThinLens(f_number, focal_length, focus, float(f"{pitch:.5g}"))


PLAIN = Camera(lens(), SHAPE, cos4=True, full_well=30_000.0, read_noise=0.0005)
#: By what each differs from the first.
CAMERAS = {
    "plain": PLAIN,
    "f2.8": replace(PLAIN, lens=lens(f_number=2.8), blades=6),
    "inside": replace(PLAIN, lens=lens(focus=1.2)),
    "long": replace(PLAIN, lens=lens(focal_length=0.035, angle=40.0)),
    "old-lens": replace(
        PLAIN, ring=(0.03, 0.018), lateral=(0.0006, 0.0, -0.0006), longitudinal=(0.03, 0.0, -0.03)
    ),
    "poor-file": replace(PLAIN, full_well=3_000.0, read_noise=0.003, jpeg=85),
}
#: Metres that the image at f/8 is focused at, where it is not where the other one is.
SHARP_FOCUS = {"old-lens": 1.0}


class Rooms(Whole):
    """The rooms as one camera sees them."""

    captures_defocus = True

    def __init__(self, manifest: Manifest) -> None:
        super().__init__(manifest)
        self._camera = CAMERAS[manifest.name]
        self._sharp_focus = SHARP_FOCUS.get(manifest.name)

    def signature(self, scene: str) -> str:
        """Return a hash of all that the scene is made of."""
        made_of = (GENERATOR, SEED, scene, self._camera, self._sharp_focus)
        return hashlib.sha256(repr(made_of).encode()).hexdigest()

    def read(self, scene: str) -> SceneImages:
        """Photograph one room."""
        number, focus = scene_number(scene), self._sharp_focus
        pair = render_pair(SEED, number, self._camera, sharp_focus=focus)
        images = pair.images[np.newaxis]
        return SceneImages(images, pair.depth, np.ones(1, bool), found=pair.facts)


def built(name: str, folder: Path) -> Dataset:
    """Build a camera's set, or what it lacks."""
    text = unseen_text("unseen", SEED, ROOMS, ROOMS).replace(f'"unseen-{SEED}"', f'"{name}"')
    manifest = parse_manifest(text.encode(), f"{name}-1.toml")
    report = build_store(manifest, Rooms(manifest), folder / f"{name}.zarr")
    print(f"built {name}", file=sys.stderr, flush=True)
    return Dataset(report.path)


def measure(folder: Path) -> pd.DataFrame:
    """Return NRMSE by method, what it was fitted on and what it was tested on."""
    stores = [built(name, folder) for name in CAMERAS]
    rows = []
    for store in stores:
        own = dfdbench.run(FLOOR, store, out=folder / FLOOR / store.manifest.short).result
        rows.append((FLOOR, store.manifest.short, store.manifest.short, own.averages))
    for method in METHODS:
        found = dfdbench.run_transfer(
            method,
            stores,
            out=folder / method,
            on_result=lambda label, _: print(label, file=sys.stderr, flush=True),
        )
        rows += [(method, *pair, result.averages) for pair, result in found.results.items()]
    scores = [(*names, (means or {})["valid"]["nrmse"]) for *names, means in rows]
    return pd.DataFrame(scores, columns=["method", "fitted", "tested", "nrmse"]).round(5)


def matrices(scores: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return each method's matrix: a row per camera of the fit, a column per camera of the test."""
    return {
        str(method): rows.pivot(index="fitted", columns="tested", values="nrmse").loc[
            list(CAMERAS), list(CAMERAS)
        ]
        for method, rows in scores[scores["method"] != FLOOR].groupby("method", sort=False)
    }


def draw(scores: pd.DataFrame) -> Figure:
    """Draw the matrices of all methods in the same colours."""
    found = matrices(scores)
    figure = Figure((5 * 3, 5 * 2), layout="constrained")
    axes = figure.subplots(2, 3)
    for axis in axes.flat[len(found) :]:
        axis.set_axis_off()
    for (method, means), axis in zip(found.items(), axes.flat, strict=False):
        image = draw_transfer(axis, means, most=4.0)
        axis.set_title(method)
    figure.colorbar(image, ax=axes, label=f"NRMSE {OVER_OWN}", extend="max", shrink=0.6)
    return figure


def main(folder: str = "") -> None:
    """Measure and draw, where a folder is named; print."""
    if folder:
        scores = measure(Path(folder))
        scores.to_csv(TABLE, index=False, lineterminator="\n")
        draw(scores).savefig(TABLE.with_suffix(".png"), dpi=70)
    scores = pd.read_csv(TABLE)
    floor = scores[scores["method"] == FLOOR]["nrmse"].mean()
    print("| method | own fit | foreign fit | worst over own | fitted on, tested on |")
    print("|:---|---:|---:|---:|:---|")
    for method, means in matrices(scores).items():
        own = np.diag(means)
        shares = means.to_numpy() / own
        fitted, tested = np.unravel_index(shares.argmax(), shares.shape)
        foreign = means.to_numpy()[~np.eye(len(means), dtype=bool)].mean()
        print(
            f"| `{method}` | {own.mean():.4f} | {foreign:.4f} | {shares.max():.2f} | "
            f"`{means.index[fitted]}`, `{means.columns[tested]}` |"
        )
    print(f"| `{FLOOR}` | {floor:.4f} | – | – | – |")
    for method, means in matrices(scores).items():
        print(f"\n{method}\n{means.to_string(float_format='{:.4f}'.format)}")


if __name__ == "__main__":
    main(*sys.argv[1:])
