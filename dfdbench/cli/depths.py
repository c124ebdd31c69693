"""The verb that counts depth levels, and asks how far runs are off at each of them: depths."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dfdbench.audit.depth_errors import (
    DepthErrors,
    constant_errors,
    depth_error_tables,
    depth_errors,
    level_count_table,
)
from dfdbench.audit.sides import scene_histograms, side_of
from dfdbench.cli.completion import data_sets
from dfdbench.cli.options import Cache
from dfdbench.cli.screen import print_table, save_figure
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.manifest import ALL_PAIRS
from dfdbench.errors import InputError, StoreError
from dfdbench.figures.audits import depth_error_figure, depths_figure
from dfdbench.results.record import Result
from dfdbench.results.record_file import load_result
from dfdbench.results.wording import method_label
from dfdbench.tables.render import render
from dfdbench.tables.table import Format, Table

_CONSTANT = "constant"


def depths(
    dataset: Annotated[
        str, typer.Argument(help="A data set's name or a store's path.", autocompletion=data_sets)
    ],
    split: Annotated[
        str | None, typer.Option(help="A split, a fold, a scene, or all, which is the default.")
    ] = None,
    result: Annotated[
        list[Path] | None,
        typer.Option(help="A run's folder: show its errors by depth; repeatable."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the histogram, or errors, there.")
    ] = None,
    format: Annotated[Format, typer.Option(help="How the table is printed.")] = Format.table,
    cache: Cache = None,
) -> None:
    """Count how often each depth occurs, or with --result how far runs are off at each depth."""
    store = open_dataset(dataset, cache=cache)
    if result:
        if split is not None:
            raise InputError("a run says itself which split it is of", where="--split")
        tables = _errors(store, result, figure)
    else:
        scenes = store.manifest.scenes_of(split or ALL_PAIRS)
        side = side_of(store, scene_histograms(store), split or ALL_PAIRS, scenes)
        if figure is not None:
            save_figure(depths_figure(side), figure)
        tables = [level_count_table(side)]
    if format is Format.table:
        for table in tables:
            print_table(table)
    else:
        print(render(tables, format), end="")


def _errors(store: Dataset, places: list[Path], figure: Path | None) -> list[Table]:
    runs = [(place.parent if place.is_file() else place, load_result(place)) for place in places]
    labels = [method_label(result.method) for _, result in runs]
    found = []
    for (folder, result), label in zip(runs, labels, strict=True):
        # Two runs of one method are told apart by their folders.
        name = f"{label}, {folder.name}" if labels.count(label) > 1 else label
        found.append(depth_errors(store, result, folder, name))
    first = runs[0][1]
    if _CONSTANT not in labels:
        found += _constant(store, first)
    tables = depth_error_tables(store, first.dataset.split, found)
    if figure is not None:
        title = f"{store.manifest.label}, split {first.dataset.split}: errors by depth"
        save_figure(depth_error_figure(title, found, store.manifest.depth.scale), figure)
    return tables


def _constant(store: Dataset, result: Result) -> list[DepthErrors]:
    from dfdbench.evaluation.loading import training_mean

    try:
        level = training_mean(store)
    except StoreError:  # nothing to train on: then there is no constant to stand beside
        return []
    return [constant_errors(store, result, level, _CONSTANT)]
