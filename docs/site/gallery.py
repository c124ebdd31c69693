"""Every figure that the package draws, with the command that draws it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

PICTURES = Path(__file__).parents[1] / "assets/pictures/gallery"
PAGE = """---
description: Every figure that dfdbench draws, each with the command that draws it.
---

# Gallery of figures

Each picture is what the command above it writes. Run the commands in this order: most need the
first run. `--figure-format pdf` gives a run's and a report's figures as vectors too.
`python docs/site/pictures.py gallery` draws this page's pictures anew.
"""


@dataclass(frozen=True)
class Drawn:
    """A figure: the function that draws it, the command, the file it writes and what it shows.

    `before` are commands that it needs besides those of the figures above it.
    """

    function: str
    command: str
    file: str
    words: str
    before: tuple[str, ...] = ()

    @property
    def picture(self) -> Path:
        """Where the site has it."""
        return PICTURES / f"{self.function.removesuffix('_figure').replace('_', '-')}.jpg"


_RUN = "dfdbench run --method local --dataset demo --split Kitchen"
_LOCAL, _OTHER = "results/demo-1-Kitchen/local", "results/demo-1-Kitchen/s-transform"
_SHOW = (
    "python -c \"import dfdbench; run = dfdbench.open_run('{run}'); "
    "dfdbench.show(*run.images('{pair}')).savefig('pair.png')\""
).format(run=_LOCAL, pair="Kitchen/view1/illumination1/exposure2")
_BOTH = f"{_LOCAL} {_OTHER}"
_REPORT = f"dfdbench report {_BOTH} --format markdown --out page"
_COVERAGE = f"dfdbench audit coverage demo --result {_LOCAL}"
_ERRORS = f"{_LOCAL}/coverage"
_TRAIN = "dfdbench train dfd-net --dataset demo --config quick --set steps=100"
_TRAIN += " --set evaluate_every=20 --threads 1"
_TRAINED = "training/demo-1-train/dfd-net-quick"
_SEARCH = "dfdbench thesis search architecture --dataset demo --split test --config quick"
_SEARCH += " --particles 3 --iterations 3 --steps 10 --score-pairs 1 --threads 1"
_FOUND = "training/demo-1-search/thesis-quick"
_EXPERIMENT = "dfdbench thesis experiment noise --dataset demo --config quick --values 0,2"
_EXPERIMENT += " --repeats 2 --set steps=20 --threads 1"
GALLERY: dict[str, tuple[Drawn, ...]] = {
    "A run": (
        Drawn(
            "panel_figure",
            _RUN,
            f"{_LOCAL}/figures/worst.png",
            "The three worst pairs, with their errors; best.png has the best.",
            ("dfdbench build demo",),
        ),
        Drawn(
            "score_figure", _RUN, f"{_LOCAL}/figures/scores.png", "Every score by scene and light."
        ),
        Drawn(
            "depth_figure",
            _RUN,
            f"{_LOCAL}/figures/depths.png",
            "How often each depth level is true, and how often it is predicted.",
        ),
        Drawn("show", _SHOW, "pair.png", "A pair and a prediction, from Python or in a notebook."),
        Drawn(
            "sureness_figure",
            f"{_RUN} --param sure=true",
            f"{_LOCAL}-sure=true/figures/sureness.png",
            "How well a method knows where it errs: error over the surest pixels.",
        ),
        Drawn(
            "predicted_figure",
            f"dfdbench predict pairs/sharp.png pairs/blurred.png --method local --fitted {_LOCAL} "
            "--out depth.png --figure predicted.png",
            "predicted.png",
            "Two photographs without a data set, and the depth estimated from them.",
        ),
    ),
    "Runs side by side": (
        Drawn(
            "change_figure",
            f"dfdbench compare {_BOTH}",
            "results/compare-demo-1-Kitchen-local-vs-s-transform.png",
            "The pairs on which two runs differ most.",
            ("dfdbench run --method s-transform --dataset demo --split Kitchen",),
        ),
        Drawn(
            "accuracy_figure",
            f"dfdbench report {_BOTH} --format table --figure accuracy.png",
            "accuracy.png",
            "Error against seconds per pair.",
        ),
        Drawn("lighting_figures", _REPORT, "page/1-scores-by-illumination.png", "Scores by light."),
        Drawn("time_figure", _REPORT, "page/1-seconds-per-pair.png", "Seconds per pair."),
        Drawn(
            "tracks_figure",
            "dfdbench tracks --method s-transform --dataset demo --split Kitchen --track psf "
            "--track noise --track gain",
            "results/demo-1-tracks-Kitchen/s-transform/tracks.png",
            "Error on each track by severity.",
        ),
        Drawn(
            "transfer_figure",
            "dfdbench transfer --method s-transform --dataset demo@psf-1 --dataset demo@psf-3 "
            "--split Kitchen",
            "results/transfer-Kitchen/s-transform/transfer.png",
            "A fit of each data set, tested on all of them.",
        ),
    ),
    "Is the test fair?": (
        Drawn(
            "depths_figure",
            "dfdbench audit depths demo --figure depths.png",
            "depths.png",
            "How often each depth level occurs.",
        ),
        Drawn(
            "depth_error_figure",
            f"dfdbench audit depths demo --result {_LOCAL} --figure errors_by_depth.png",
            "errors_by_depth.png",
            "A run's error and answers by true depth.",
        ),
        Drawn(
            "coverage_figure",
            _COVERAGE,
            f"{_ERRORS}/coverage.png",
            "Depths of the test beside those of training; what training lacks is marked.",
        ),
        Drawn("level_error_figure", _COVERAGE, f"{_ERRORS}/errors.png", "Error by coverage."),
        Drawn("mask_figure", _COVERAGE, f"{_ERRORS}/masks.png", "Where uncovered depths are."),
        Drawn(
            "difficulty_figure",
            "dfdbench audit difficulty demo --split Kitchen",
            "results/demo-1-difficulty/Kitchen/difficulty.png",
            "By how many levels depth may change before any image does.",
        ),
        Drawn(
            "bound_figure",
            "dfdbench audit difficulty demo --split Kitchen --bound",
            "results/demo-1-bound/Kitchen/bound.png",
            "The least error that blur allows.",
        ),
    ),
    "A camera": (
        Drawn(
            "law_figure",
            "dfdbench run --method local --param prior=false --dataset demo@psf-1 --split Kitchen "
            "--limit 2",
            "results/demo-1@psf-1-Kitchen/local-prior=false/figures/law.png",
            "What a fit measured: blur by depth, its shape, noise.",
        ),
        Drawn(
            "blur_figure",
            "dfdbench rig optics blur --f-number 2.8 --focal-length 9.6mm --focus 0.5m "
            "--pixel 4.8um",
            "blur.png",
            "A thin lens's blur by distance.",
        ),
        Drawn(
            "pair_figure",
            "dfdbench rig optics pairs",
            "pairs.png",
            "The pairs of voltage steps whose blur tells distances apart best.",
        ),
        Drawn(
            "temperature_figure",
            "dfdbench rig optics sharpness lens",
            "sharpness/temperature.png",
            "A lens's sharpness while it warms up.",
            ("dfdbench rig simulate lens --out lens",),
        ),
        Drawn(
            "voltage_figure",
            "dfdbench rig optics sharpness lens",
            "sharpness/voltage.png",
            "Its sharpness by voltage, up and down.",
        ),
        Drawn(
            "overlay_figure",
            "dfdbench rig register k34 --source raw",
            "raw/k34/registration.png",
            "LIDAR depth laid on the camera's image.",
            (
                "dfdbench rig simulate realworld --out raw --steps 129,141 --exposures 40 "
                "--scenes k34",
            ),
        ),
    ),
    "Training and search": (
        Drawn(
            "training_figure",
            _TRAIN,
            f"{_TRAINED}/training.png",
            "Loss, learning rate and scores by step.",
        ),
        Drawn(
            "levels_figure",
            _TRAIN,
            f"{_TRAINED}/depth_levels.png",
            "Which depth levels the drawn patches show.",
        ),
        Drawn(
            "patches_figure",
            _TRAIN,
            f"{_TRAINED}/patches.png",
            "How often each pixel of the training images was drawn.",
        ),
        Drawn(
            "cameras_figure",
            "dfdbench train volume-net --dataset demo --set steps=20 --threads 1",
            "training/demo-1-train/volume-net/training.png",
            "Loss of the network that reads a volume of costs.",
        ),
        Drawn(
            "experiment_figure",
            _EXPERIMENT,
            "training/demo-1-experiments/noise-dfd-net/noise.png",
            "Scores by the value that an experiment of the thesis varies.",
        ),
        Drawn(
            "objective_figure",
            _SEARCH,
            f"{_FOUND}/objective.png",
            "The swarm's objective by iteration.",
        ),
        Drawn(
            "convergence_figure", _SEARCH, f"{_FOUND}/convergence.png", "How the swarm converges."
        ),
        Drawn("widths_figure", _SEARCH, f"{_FOUND}/widths.png", "The widths of what was found."),
    ),
}
#: Figures that no picture here shows, and why.
NOT_SHOWN = {
    "pixel_time_figure": "seconds by image size: needs a set with images of several sizes",
    "group_figures": "scores by texture, geometry and such: needs scenes that say these",
}


def gallery_page() -> str:
    """Return the page: each figure with its command, and those that need other data."""
    parts = [PAGE]
    for title, figures in GALLERY.items():
        parts.append(f"\n## {title}\n")
        for one in figures:
            heading = one.picture.stem.replace("-", " ")
            before = "".join(f"{line}\n" for line in one.before)
            alt = re.sub(r"[\[\]]", "", one.words)
            parts += [
                f"### {heading}\n",
                f"{one.words}\n",
                f"```\n{before}{one.command}\n```\n",
                f"![{alt}](assets/pictures/gallery/{one.picture.name}){{ .plot loading=lazy }}\n",
            ]
    parts.append("\n## Not shown here\n")
    parts += [f"- `{name}`: {why}." for name, why in NOT_SHOWN.items()]
    return "\n".join(parts) + "\n"
