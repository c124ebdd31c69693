"""Searches so small that they end in seconds."""

from pathlib import Path
from typing import Any

import numpy as np

from dfdbench.datasets.dataset import Dataset
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.search.log import LogRow, Outcome
from dfdbench.training.search.particle import begun, bounds_of
from dfdbench.training.search.search_plan import Choices, SearchPlan, plan_search

SMALL = {"narrow": 64, "crop": 16, "crops_per_step": 1, "steps": 2, "expansion": "one"}
BOUNDS = {"crop": "12:16", "kernel": "1:3", "width": "8:128"}


def small_plan(
    store: Dataset, configuration: dict[str, Any] | None = None, **choices: Any
) -> SearchPlan:
    """Return a search on the tiny set: trains on one scene of `test`, selects on the other."""
    base = TrainingConfiguration.model_validate(SMALL | (configuration or {}))
    few: dict[str, Any] = {"particles": 2, "pairs": 1, "bounds": bounds_of(BOUNDS)}
    return plan_search(store, base, {}, Choices(**({"split": "test"} | few | choices)), "cpu")


def some_rows(plan: SearchPlan) -> list[LogRow]:
    """Return rows of a start whose last training failed."""
    rows = []
    for number, position in enumerate(begun(plan.box, 3, 0).positions):
        scores = {"nrmse": 0.1 + number / 10, "nmae": 0.1, "ssim": 0.7}
        outcome = Outcome(0.5 + number / 10, "", scores, scores, 1000, 2, 0.5)
        rows.append(LogRow((0, number), np.asarray(position), outcome))
    rows[-1] = LogRow((0, 2), rows[-1].position, Outcome(failed="diverged: at\nstep 3"))
    return rows


def losses(folder: Path) -> str:
    """Return a search's log without the times, which no two searches share."""
    lines = (folder / "positions.csv").read_text().splitlines()
    cells = [line.split(",") for line in lines]
    return "\n".join(",".join(row[:6] + row[7:]) for row in [cells[0], *sorted(cells[1:])])
