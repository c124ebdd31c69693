"""How a search went, iteration by iteration, and what it found; `run.py` carries it out."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dfdbench.methods.networks.choices import FILTERS, LAYERS, SITES, SIZED
from dfdbench.tables.table import Table
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.search.evaluation import PARTS
from dfdbench.training.search.log import Row
from dfdbench.training.search.particle import Particle, particle_at, whole_numbers
from dfdbench.training.search.plan import SearchPlan
from dfdbench.training.search.swarm import Numbers, Swarm

#: Shares of equal components at which the thesis's author calls a swarm converged.
MARKS = (0.90, 0.95, 0.99)


@dataclass(frozen=True)
class Iteration:
    """What a whole iteration came to.

    Parameters
    ----------
    number : int
        0 at the start.
    best : float
        The least value so far.
    least, mean : float
        Of this iteration's trainings that did not fail; NaN where all did.
    failed : int
        How many did.
    alike : float
        The share of all particles' components that are equal to the best position's.
    """

    number: int
    best: float
    least: float
    mean: float
    failed: int
    alike: float


def iteration_of(swarm: Swarm, values: Numbers) -> Iteration:
    """Return what an iteration came to.

    Parameters
    ----------
    swarm : Swarm
        Judged.
    values : ndarray of float64, shape (particles,)
        Of its positions.
    """
    there = values[np.isfinite(values)]
    least, mean = (float(there.min()), float(there.mean())) if len(there) else (np.nan, np.nan)
    alike = whole_numbers(swarm.positions) == whole_numbers(swarm.best)
    failed = len(values) - len(there)
    return Iteration(swarm.iteration, swarm.best_value, least, mean, failed, float(alike.mean()))


def course_table(plan: SearchPlan, course: Sequence[Iteration], failures: Sequence[Row]) -> Table:
    """Return a row an iteration: best and mean objective, failures, convergence."""
    rows = tuple(
        (
            "start" if item.number == 0 else str(item.number),
            f"{item.best:.4f}",
            f"{item.least:.4f}",
            f"{item.mean:.4f}",
            str(item.failed),
            f"{100 * item.alike:.1f} %",
        )
        for item in course
    )
    notes = [f"selected on {plan.selected_on}", f"gamma {plan.choices.gamma:g}"]
    for row in failures:
        iteration, particle = row.place
        notes.append(f"iteration {iteration}, particle {particle}: {row.outcome.failed}")
    return Table(
        f"particle swarm, {plan.choices.particles} particles, variant {plan.choices.variant}",
        ("iteration", "best so far", "least", "mean", "failed", "as the best"),
        rows,
        "lrrrrr",
        tuple(notes),
        records=tuple(item.__dict__ for item in course),
    )


def network_table(plan: SearchPlan, best: Row) -> Table:
    """Return the network found, layer by layer, the baseline's widths beside it."""
    particle = particle_at(best.position)
    sizes = dict(zip(SIZED, particle.kernels, strict=True))
    rows = [
        (
            str(layer),
            str(width),
            str(usual),
            "{} x {}".format(*sizes.get(layer, (2, 2))),
            *_site_of(layer, particle),
        )
        for layer, width, usual in zip(LAYERS, particle.filters, FILTERS["original"], strict=True)
    ]
    iteration, number = best.place
    configuration = plan.configuration_of(particle)
    outcome = best.outcome
    notes = [f"found in iteration {iteration}, particle {number}: objective {outcome.value:.4f}"]
    for name, scores in (("training pairs", outcome.train), ("pairs selected on", outcome.other)):
        notes.append(f"{name}: " + ", ".join(f"{p.upper()} {scores[p]:.4f}" for p in PARTS))
    notes.append(f"patches of {particle.crop}, {configuration.crops_per_step} a step")
    divided = f", all widths but the last divided by {plan.base.narrow}"
    notes.append(f"{outcome.parameters:,} parameters" + (divided if plan.base.narrow > 1 else ""))
    return Table(
        "the best network",
        ("layer", "filters", "baseline", "rows x columns", "normalized", "activation"),
        tuple(rows),
        "lrrrll",
        tuple(notes),
    )


def _site_of(layer: int, particle: Particle) -> tuple[str, str]:
    # What follows the convolution of this layer; before layer 1 they stand alone, after layer 5.
    sites = dict(zip((52, 48, 40, 32, 24, 20, 12, 8, 5), range(len(SITES)), strict=True))
    if layer not in sites:
        return "", ""
    place = sites[layer]
    return "yes" if particle.normalized[place] else "no", particle.activations[place]


def best_as_toml(plan: SearchPlan, best: Row) -> str:
    """Return the best network as a configuration that ``dfdbench train dfd-net`` takes."""
    fields = TrainingConfiguration.model_fields
    found = plan.configuration_of(particle_at(best.position))
    named = ("filters", "kernels", "activations", "normalized", "crop", "crops_per_step")
    content: dict[str, Any] = {
        name: value
        for name, value in found.model_dump(mode="json").items()
        if name in named or (value is not None and getattr(found, name) != fields[name].default)
    }
    lines = [
        f"# Found by a particle swarm on {plan.store.manifest.stem}, objective "
        f"{best.outcome.value:.6g},",
        f"# selected on {plan.selected_on}.",
        *(f"{name} = {json.dumps(value)}" for name, value in content.items()),
    ]
    return "\n".join(lines) + "\n"
