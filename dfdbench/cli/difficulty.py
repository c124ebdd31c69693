"""The verb that says how much of the depth the images can show: difficulty."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dfdbench.audit.difficulty import (
    COARSE,
    Difficulty,
    difficulty_as_json,
    difficulty_rows,
    difficulty_table,
    smallest_step,
)
from dfdbench.audit.sides import depth_maps
from dfdbench.blur.recipe import LAST_LEVEL
from dfdbench.cli.answer import Answer, AnswerFormat, give
from dfdbench.cli.completion import data_sets
from dfdbench.cli.screen import progress
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.errors import InputError
from dfdbench.figures.audits import difficulty_figure
from dfdbench.results.output_place import output_place


def difficulty(
    dataset: Annotated[
        str, typer.Argument(help="A data set's name or a store's path.", autocompletion=data_sets)
    ],
    split: Annotated[str, typer.Option(help="A split, a fold, a scene, or all.")] = "test",
    noise: Annotated[
        int, typer.Option(min=0, max=255, help="Whole grey levels that a change must exceed.")
    ] = 0,
    out: Annotated[
        str | None, typer.Option(help="Folder; default: results/DATASET-difficulty/SPLIT.")
    ] = None,
    format: Annotated[
        AnswerFormat, typer.Option(help="How the answer is printed.")
    ] = AnswerFormat.table,
) -> None:
    """Say for which pixels the blur cannot tell neighbouring depth levels apart."""
    store = open_dataset(dataset)
    default = Path("results") / f"{store.path.stem}-difficulty" / split
    folder = output_place(default if out is None else out)
    manifest = store.manifest
    manifest.scenes_of(split)
    pairs = store.pairs(split)
    if store.recipe is None:
        why = "its track tells none" if manifest.on_track else "captured images"
        raise InputError(f"no blur recipe is known: {why}", where=str(store.path))
    if not pairs:
        raise InputError(f"no pair of split {split}", where=str(store.path))
    for scene in dict.fromkeys(pair.scene for pair in pairs):
        depth_maps(store, scene)
    found: dict[Pair, Difficulty] = {}
    with progress("looking at pairs", "nothing was written") as step:
        for number, pair in enumerate(pairs, 1):
            found[pair] = _difficulty_of(store, pair, noise)
            step(number, len(pairs))
    rows = difficulty_rows(manifest, found)
    content = difficulty_as_json(manifest, store.fingerprint, noise, rows)
    order = sorted(found, key=lambda pair: found[pair].share_above(COARSE))
    # The easiest pair, the middle one and the hardest.
    chosen = dict.fromkeys((order[0], order[len(order) // 2], order[-1]))
    figure = difficulty_figure(
        f"easiest, median and hardest pair of {manifest.label}, {split}",
        [(pair.id, store.read(pair).infocus, found[pair]) for pair in chosen],
    )
    answer = Answer(content, (difficulty_table(manifest, rows, noise),))
    give(answer, format, folder, {"difficulty.json": content, "difficulty.png": figure})


def _difficulty_of(store: Dataset, pair: Pair, noise: int) -> Difficulty:
    images, recipe = store.read(pair), store.recipe
    assert recipe is not None
    depth = images.levels
    if store.manifest.depth.grows_with == "distance":
        depth = LAST_LEVEL - depth
    return smallest_step(images.infocus, depth, images.valid, recipe, noise)
