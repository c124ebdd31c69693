"""What to train on what, what to start from, and how to score the validation pairs."""

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import torch
from torch import nn

from dfdbench.blur.recipe import RECIPES, BlurRecipe
from dfdbench.blur.tracks import OF_PATCHES
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest, Pair, require_fold, training_of
from dfdbench.errors import InputError, StoreError
from dfdbench.methods.networks.inference import Predictor, Readout
from dfdbench.methods.networks.weights import build_network, described, load_weights, weights_sha256
from dfdbench.metrics.metric import METRICS
from dfdbench.metrics.protocol import PROTOCOLS, Protocol, find_protocol, score
from dfdbench.system.text import require_same
from dfdbench.training import crops
from dfdbench.training.configuration import TrainingConfiguration


@dataclass(frozen=True)
class Task:
    """What to train on which pairs.

    Parameters
    ----------
    method : str
        ``dfd-net`` or ``u-net``.
    store : Dataset
        The data set.
    train, test : tuple of Pair
        Pairs to train on, and pairs to score.
    trained_on : str
        The training pairs, in words that `dfdbench.audit.leaks` can read.
    tested_on : str
        The name of the split or fold that tests.
    configuration : TrainingConfiguration
        Every other choice.
    seed : int
        Seed of weights, patches and noise.
    start : Path, optional
        Weights to start from, in place of random ones.
    """

    method: str
    store: Dataset
    train: tuple[Pair, ...]
    test: tuple[Pair, ...]
    trained_on: str
    tested_on: str
    configuration: TrainingConfiguration
    seed: int
    start: Path | None = None

    @property
    def recipe(self) -> BlurRecipe | None:
        """How patches are blurred; None if unknown."""
        named = self.configuration.recipe
        return RECIPES[named] if named else self.store.recipe

    @property
    def identity(self) -> dict[str, Any]:
        """What must be unchanged to continue from a checkpoint."""
        return {
            "method": self.method,
            "manifest_sha256": self.store.manifest.sha256,
            "fingerprint": self.store.fingerprint,
            "trained_on": self.trained_on,
            "seed": self.seed,
            "start": weights_sha256(self.start) if self.start else None,
            "configuration": self.configuration.model_dump(mode="json"),
        }


def task_of(
    method: str,
    store: Dataset,
    configuration: TrainingConfiguration,
    split: str = "train",
    fold: str | None = None,
    seed: int = 0,
    start: Path | None = None,
) -> Task:
    """Return the task of training on a split, or on all scenes except a fold or a scene's group.

    Raises
    ------
    StoreError
        If the store holds no pair to train on.
    UnknownNameError
        If there is no such split or fold.
    """
    manifest = store.manifest
    if fold is not None:
        require_fold(manifest, fold)
        scenes = training_of(manifest, fold)
        train = tuple(pair for pair in store.pairs("all") if pair.scene in scenes)
        tested, trained_on = fold, f"{manifest.stem}, all but {fold}"
    else:
        train = store.pairs(split)
        tested, trained_on = other_part(manifest, split), f"{manifest.stem}, split {split}"
    if configuration.tracks:
        every = list(configuration.tracks) == list(OF_PATCHES)
        named = "" if every else ": " + " ".join(configuration.tracks)
        trained_on += f", random tracks{named}"
    if not train:
        fix = f"build {manifest.short} with the scenes of that split"
        what = f"the store holds no pair to train on, of {trained_on}"
        raise StoreError(what, where=str(store.path), fix=fix)
    test = store.pairs(tested) if tested else ()
    return Task(method, store, train, test, trained_on, tested, configuration, seed, start)


def other_part(manifest: Manifest, split: str) -> str:
    """Return the other split of a split's partition, which tests it; empty if there is none.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> other_part(find_manifest("demo"), "test"), other_part(find_manifest("demo"), "all")
    ('train', '')
    """
    partition = {item.name: item.partition for item in manifest.splits}
    own = partition.get(split)
    return next((name for name in partition if name != split and partition[name] == own), "")


def require_trainable(task: Task) -> dict[str, Any]:
    """Check that the choices of a training fit each other and the data set.

    Returns
    -------
    dict
        The network's constructor arguments.

    Raises
    ------
    InputError
        With everything that does not fit.
    """
    choices, recipe = task.configuration, task.recipe
    architecture = choices.architecture(task.method)
    with torch.device("meta"):
        multiple = int(build_network(task.method, architecture).multiple)  # type: ignore[arg-type]
    if choices.crop % multiple:
        raise InputError(f"crop {choices.crop} is not a multiple of {multiple}", where="crop")
    if choices.normalization == "fixed" and task.start is None:
        what = "normalization fixed needs weights to begin with"
        fix = "give --weights FILE, trained with normalization batch"
        raise InputError(what, where="normalization", fix=fix)
    margin = 0
    if choices.tracks and not choices.redraw_depth:
        what = "tracks form only patches whose depth is redrawn"
        raise InputError(what, where="tracks", fix="add --set redraw_depth=true")
    if choices.redraw_depth:
        if recipe is None:
            manifest = task.store.manifest
            why = "of this track is unknown" if manifest.on_track else "captured defocus has not"
            what = f"redraw_depth needs a blur recipe, which {why}"
            fix = "name one with --set recipe=published, or leave redraw_depth out"
            raise InputError(what, where=f"{manifest.short}, redraw_depth", fix=fix)
        drawn = (crops.CLEAN, *crops.severities_of(choices.tracks))
        margin = max(crops.margin_of(recipe, track) for track in drawn)
    scenes = dict.fromkeys(pair.scene for pair in task.train)
    smallest = min(min(task.store.to_xarray(name)["depth"].shape[-2:]) for name in scenes)
    if choices.crop > (fits := smallest - 2 * margin):
        what = f"crops of {choices.crop} do not fit the images, at most {fits} do"
        raise InputError(what, where="crop")
    return architecture


#: The first protocol of the training scores, and the one in figures.
PROTOCOL = "thesis"
#: All protocols of the training scores; Tables 5.6 and 5.7 use the second.
LOGGED = (PROTOCOL, find_protocol("thesis-networks").label)


def evenly_spaced(pairs: Sequence[Pair], count: int) -> tuple[Pair, ...]:
    """Return some of the pairs, spread evenly over all.

    Examples
    --------
    >>> evenly_spaced("abcdef", 3)
    ('a', 'c', 'e')
    """
    count = min(count, len(pairs))
    return tuple(pairs[index * len(pairs) // count] for index in range(count))


def mean_scores(
    network: nn.Module,
    store: Dataset,
    pairs: Sequence[Pair],
    device: torch.device,
    readout: Readout = "mode",
    protocols: Sequence[Protocol] = tuple(map(PROTOCOLS.__getitem__, LOGGED)),
    centre: tuple[int, int] | None = None,
) -> dict[str, dict[str, float]]:
    """Return the mean of each metric over pairs, under each protocol by its label.

    A metric is absent if no pair defines it.

    Parameters
    ----------
    network : nn.Module
        Unchanged: a copy is evaluated.
    store : Dataset
        The store of the pairs.
    pairs : sequence of Pair
        The pairs.
    device : torch.device
        Where the network runs.
    readout : {"mode", "median"}
        Which level of a pixel's distribution is the answer.
    protocols : sequence of Protocol
        By default those of `LOGGED`.
    centre : tuple of int, optional
        Score only this many rows and columns in the centre of each image.
    """
    predict = Predictor(copy.deepcopy(network).eval(), device, readout=readout)
    found: dict[str, list[dict[str, float]]] = {protocol.label: [] for protocol in protocols}
    for pair in pairs:
        images = store.read(pair).two_of(store.manifest.pair_images)
        levels = predict(images.infocus, images.defocus).astype(np.float32)
        at = tuple(
            slice(max(0, (side - most) // 2), max(0, (side - most) // 2) + most)
            for side, most in zip(levels.shape, centre or levels.shape, strict=True)
        )
        truth, valid, crop = images.levels[at], images.valid[at], store.manifest.network_crop
        for protocol in protocols:
            found[protocol.label].append(score(protocol, truth, valid, levels[at], crop))
    means: dict[str, dict[str, float]] = {}
    for label, rows in found.items():
        defined = {name: [r[name] for r in rows if not math.isnan(r[name])] for name in METRICS}
        means[label] = {name: fmean(values) for name, values in defined.items() if values}
    return means


def begun_network(
    method: str, architecture: dict[str, Any], seed: int, start: Path | None
) -> tuple[nn.Module, str]:
    """Return the network at the start of a training, and the card's `started_from`.

    Parameters
    ----------
    method : str
        The network's name.
    architecture : dict
        Its constructor arguments; channel means are taken from the initial weights.
    seed : int
        Seed of PyTorch's initial values.
    start : Path or None
        Weights to start from instead.

    Raises
    ------
    InputError
        If the weights belong to another network.
    """
    if start is None:
        # Do not change PyTorch's global generator.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            return build_network(method, architecture), ""
    network, card = load_weights(start, method)
    if "channel_means" in architecture:
        architecture["channel_means"] = card.architecture["channel_means"]
    what = "the weights are of another network"
    require_same(card.architecture, architecture, what, str(start))
    return network, described(start, card)


def redraw_of(task: Task, images: crops.TrainingImages) -> crops.Redraw | None:
    """Return what gives patches other depths, within those of the images; None if nothing does."""
    choices = task.configuration
    if not choices.redraw_depth:
        return None
    assert task.recipe is not None, "require_trainable refuses this"
    unknown = task.store.manifest.depth.unknown
    there = torch.unique(torch.cat([levels.flatten() for levels in images.levels]))
    known = there[(there >= 0) & (there != unknown)]
    ends, tracks = (int(known.min()), int(known.max())), crops.severities_of(choices.tracks)
    return crops.Redraw(task.recipe, *ends, choices.tilt, unknown, tracks)
