"""Plan a search: what it varies, on what data, and how it selects; all checked before it begins."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, Problem, StoreError, refuse_both, unknown_name
from dfdbench.methods.networks.inference import find_device
from dfdbench.system.packages import PACKAGE_VERSION
from dfdbench.tables.table import grouped
from dfdbench.training.configuration import TrainingConfiguration, settled
from dfdbench.training.search import particle as pso
from dfdbench.training.task import Task, require_trainable, task_of

#: Version of the search's record.
VERSION = 1
#: Choices that a particle makes.
VARIED = ("filters", "first_activation", "kernels", "activations", "normalized")
#: Of the training scenes, held out to select on.
_HELD_OUT = 1 / 5


@dataclass(frozen=True)
class Choices:
    """What the user chooses for a search, except data, base and budget.

    Parameters
    ----------
    split : str
        The split to train on.
    as_thesis : bool
        Select on the test split, as published; else on scenes held out of the training split.
    held_out : int or None
        How many scenes to hold out, or more, as groups stay whole; None for a fifth, at least one.
    gamma : float
        Weight of the training pairs in Eq. 6.1.
    variant : str
        One of `VARIANTS`.
    bounds : Bounds
        What a particle may describe.
    particles : int
        How many particles.
    pairs : int or None
        How many pairs of each set to score; None for all.
    seed : int
        Seed of the swarm, of the held-out scenes, and of every training's seed.
    """

    split: str = "train"
    as_thesis: bool = False
    held_out: int | None = None
    gamma: float = 0.3
    variant: str = "thesis"
    bounds: pso.Bounds = field(default_factory=pso.Bounds)
    particles: int = 20
    pairs: int | None = None
    seed: int = 0


@dataclass(frozen=True)
class SearchPlan:
    """A checked search.

    Parameters
    ----------
    store : Dataset
        The data set.
    base : TrainingConfiguration
        Every choice that a particle does not make.
    choices : Choices
        The user's choices.
    train, other : tuple of str
        Scenes to train on, and scenes to select on.
    """

    store: Dataset
    base: TrainingConfiguration
    choices: Choices
    train: tuple[str, ...]
    other: tuple[str, ...]

    @property
    def author(self) -> bool:
        """Whether to follow the author's programs rather than the thesis's text."""
        return self.choices.variant == "author"

    @property
    def box(self) -> pso.Box:
        """Where particles may be."""
        return pso.box_of(self.choices.bounds, self.author)

    @property
    def known(self) -> pso.Numbers | None:
        """Where the first particle starts: the author's at DfD-Net itself, others at random."""
        return pso.published_position() if self.author else None

    @property
    def selected_on(self) -> str:
        """The data on which networks were selected, in words."""
        names = ", ".join(self.other)
        if self.choices.as_thesis:
            return f"the TEST scenes, as the thesis did: {names}. Scores on them say too much"
        drawn = f"drawn from seed {self.choices.seed}"
        return f"scenes held out of {self.choices.split}, {drawn}: {names}"

    @property
    def trained_on(self) -> str:
        """The training scenes in words, for the weights' cards."""
        left_out = "" if self.choices.as_thesis else f", less {' '.join(self.other)}"
        return f"{self.store.manifest.stem}, split {self.choices.split}{left_out}"

    @property
    def identity(self) -> dict[str, Any]:
        """What must be unchanged to continue a search."""
        choices = self.choices
        return {
            "version": VERSION,
            "dfdbench": PACKAGE_VERSION,
            "manifest_sha256": self.store.manifest.sha256,
            "fingerprint": self.store.fingerprint,
            "train": list(self.train),
            "selected_on": self.selected_on,
            "gamma": choices.gamma,
            "variant": choices.variant,
            "bounds": choices.bounds.model_dump(mode="json"),
            "particles": choices.particles,
            "pairs": choices.pairs,
            "seed": choices.seed,
            "configuration": self.base.model_dump(mode="json"),
        }

    def configuration_of(self, particle: pso.Particle) -> TrainingConfiguration:
        """Return the training of a particle's network.

        The number of patches keeps the work of a step constant: the author's number for eight
        orientations, scaled to the base's number at the base's size.
        """
        base = self.base
        patches = base.crops_per_step * pso.PATCHES[particle.crop] / pso.PATCHES[base.crop]
        chosen = particle.model_dump() | {"crops_per_step": max(1, math.floor(patches + 0.5))}
        return TrainingConfiguration.model_validate(base.model_dump() | chosen)


def plan_search(
    store: Dataset,
    base: TrainingConfiguration,
    changes: Mapping[str, Any],
    choices: Choices,
    device: str = "auto",
) -> SearchPlan:
    """Return a checked search.

    Parameters
    ----------
    store, base, choices : Dataset, TrainingConfiguration, Choices
        As in `SearchPlan`.
    changes : mapping
        The choices of the base that the user set.
    device : str
        The device for training, which decides what precision ``auto`` is.

    Raises
    ------
    InputError
        If a choice is made twice, patches do not fit the images, or no scene can be held out.
    """
    if choices.variant not in pso.VARIANTS:
        raise unknown_name("variant", choices.variant, pso.VARIANTS)
    refuse_both({"--as-thesis": choices.as_thesis}, {"--hold-out": choices.held_out})
    _refuse_what_particles_choose(base, changes)
    task = task_of("dfd-net", store, base, choices.split)
    train = tuple(dict.fromkeys(pair.scene for pair in task.train))
    if choices.as_thesis:
        if not task.test:
            what = f"the store holds no pair that tests {choices.split}, to select on"
            fix = "build the whole data set, or leave --as-thesis out"
            raise StoreError(what, where=str(store.path), fix=fix)
        other = tuple(dict.fromkeys(pair.scene for pair in task.test))
    else:
        train, other = _held_out(train, store.manifest.groups, choices)
    _require_crops(task, train, choices.bounds)
    base = settled(base, find_device(device))
    return SearchPlan(store, base, choices, train, other)


def _refuse_what_particles_choose(base: TrainingConfiguration, changes: Mapping[str, Any]) -> None:
    fields = TrainingConfiguration.model_fields
    problems = [
        Problem("the search chooses this itself", where=name, fix="leave it out")
        for name in (*VARIED, "crop")
        if name in changes or (name != "crop" and getattr(base, name) != fields[name].default)
    ]
    if base.crop not in pso.PATCHES:
        known = ", ".join(map(str, pso.PATCHES))
        problems.append(Problem(f"crop is {base.crop}, not one of {known}", where="crop"))
    if base.sampling_size != 2:
        what = "particles have filters of 2 x 2 that halve and double"
        problems.append(Problem(what, where="sampling_size"))
    InputError.raise_if(problems)


def _held_out(
    train: tuple[str, ...], group_of: Mapping[str, str], choices: Choices
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Draw groups of scenes until there are enough; return the other scenes, and those."""
    count = choices.held_out or max(1, round(len(train) * _HELD_OUT))
    groups = [*grouped((group_of.get(scene, scene), scene) for scene in train).values()]
    # A group that would leave less than half to train on stays in training.
    drawn, most = list[str](), max(count, len(train) // 2)
    for number in np.random.default_rng((choices.seed, len(train))).permutation(len(groups)):
        if len(drawn) < count and len(drawn) + len(groups[number]) <= most:
            drawn += groups[number]
    if len(drawn) < count or len(drawn) == len(train):
        what = f"{len(train)} training scenes are too few to hold {count} out, with their groups"
        fix = "hold out fewer, take another split, or --as-thesis, which selects on the test"
        raise InputError(what, where=f"split {choices.split}", fix=fix)
    left = tuple(scene for scene in train if scene not in drawn)
    return left, tuple(scene for scene in train if scene in drawn)


def _require_crops(task: Task, train: tuple[str, ...], bounds: pso.Bounds) -> None:
    largest = task.configuration.model_copy(update={"crop": bounds.crop[1], "narrow": 128})
    pairs = tuple(pair for pair in task.train if pair.scene in train)
    try:
        require_trainable(replace(task, train=pairs, configuration=largest))
    except InputError as error:
        if error.problems[0].where != "crop":
            raise
        what = f"the largest patches do not fit the images: {error.problems[0].what}"
        fix = f"--bounds crop={bounds.crop[0]}:N, a multiple of 4"
        raise InputError(what, where="--bounds crop", fix=fix) from error
