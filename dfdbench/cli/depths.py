"""The verb that counts depth levels: depths."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dfdbench.audit.depth_tables import depth_table
from dfdbench.audit.sides import scene_histograms, side_of
from dfdbench.cli.options import Cache
from dfdbench.cli.screen import print_table, save_figure
from dfdbench.datasets.store import open_store
from dfdbench.figures.coverage import depths_figure
from dfdbench.tables.render import render
from dfdbench.tables.table import Format


def depths(
    dataset: Annotated[str, typer.Argument(help="A data set's name or a store's path.")],
    split: Annotated[str, typer.Option(help="A split, a fold, a scene, or all.")] = "all",
    figure: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the histogram there.")
    ] = None,
    format: Annotated[Format, typer.Option(help="How the table is printed.")] = Format.table,
    cache: Cache = None,
) -> None:
    """Count how often each depth level occurs in a built data set, or in a part of it."""
    store = open_store(dataset, cache=cache)
    scenes = store.manifest.scenes_of(split)
    side = side_of(store, scene_histograms(store), split, scenes)
    if figure is not None:
        save_figure(depths_figure(side), figure)
    table = depth_table(side)
    if format is Format.table:
        print_table(table)
    else:
        print(render([table], format), end="")
