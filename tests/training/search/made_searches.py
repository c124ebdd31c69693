"""Searches so small that they end in seconds."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dfdbench.datasets.dataset import Dataset
from dfdbench.methods.networks import choices
from dfdbench.methods.networks.architectures import ACTIVATIONS
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.search import particle as pso
from dfdbench.training.search.log import LogRow
from dfdbench.training.search.search_plan import Choices, SearchPlan, plan_search

SMALL = {"narrow": 64, "crop": 16, "crops_per_step": 1, "steps": 2, "expansion": "one"}
BOUNDS = {"crop": "12:16", "kernel": "1:3", "width": "8:128"}


def small_plan(
    store: Dataset, configuration: dict[str, Any] | None = None, **asked: Any
) -> SearchPlan:
    """Return a search on the tiny set: trains on one scene of `test`, selects on the other."""
    base = TrainingConfiguration.model_validate(SMALL | (configuration or {}))
    few: dict[str, Any] = {"particles": 2, "pairs": 1, "bounds": pso.bounds_of(BOUNDS)}
    return plan_search(store, base, {}, Choices(**({"split": "test"} | few | asked)), "cpu")


def position_of(
    filters: Sequence[int],
    kernels: Sequence[int | Sequence[int]] | None = None,
    activations: Sequence[str] | None = None,
    normalized: Sequence[bool] | None = None,
    crop: int = 32,
    first_activation: str = "prelu",
) -> pso.Numbers:
    """Return the position that describes a network, the inverse of `pso.particle_at`.

    Of filters that share a size the first one counts.
    """
    widths = dict(zip(choices.LAYERS, choices.checked_filters(filters), strict=True))
    sizes = choices.kernel_sizes(kernels)
    chosen = choices.activation_names(activations, first_activation)
    kinds = dict(zip(choices.SITES, chosen, strict=True))
    bits = dict(zip(choices.SITES, normalized or [True] * len(choices.SITES), strict=True))
    position: list[float] = []
    for layers, sized in pso.ROWS:
        position.append(widths[layers[0]])
        position += [side // 2 for layer in sized[:1] for side in sizes[layer]]
    position += [int(bits[site]) for site in reversed(choices.SITES)]
    position += [list(ACTIVATIONS).index(kinds[site]) for site in reversed(choices.SITES)]
    position.append((crop - 12) / 4)
    return np.array(position, np.float64)


def some_swarm(plan: SearchPlan) -> pso.Swarm:
    """Return a start of three particles."""
    return pso.begun(plan.box, 3, 0)


def some_rows(plan: SearchPlan) -> list[LogRow]:
    """Return rows of that start, whose last training failed."""
    rows = []
    for number, position in enumerate(some_swarm(plan).positions):
        means = {"nrmse": 0.1 + number / 10, "nmae": 0.1, "ssim": 0.7}
        scores = {f"{side}_{part}": means[part] for side in ("train", "other") for part in means}
        work = 0.5 + number / 10, "", 1000, 2, 0.5
        rows.append(LogRow((0, number), np.asarray(position), *work, scores))
    rows[-1] = LogRow((0, 2), rows[-1].position, failed="diverged: at\nstep 3")
    return rows


def losses(folder: Path) -> str:
    """Return a search's log without the times, which no two searches share."""
    lines = (folder / "positions.csv").read_text().splitlines()
    cells = [line.split(",") for line in lines]
    return "\n".join(",".join(row[:6] + row[7:]) for row in [cells[0], *sorted(cells[1:])])
