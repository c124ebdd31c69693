"""The verb that looks for filters a network can do without: reduce."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from dfdbench.cli.answer import writing
from dfdbench.cli.options import Cache, values_of
from dfdbench.cli.screen import print_table, progress, say
from dfdbench.cli.training_options import Changes, Configuration, Device, Threads, use_threads
from dfdbench.datasets.dataset import open_dataset
from dfdbench.results.output_place import output_place
from dfdbench.system.extras import needed
from dfdbench.tables.render import render
from dfdbench.tables.table import Format


class Rounding(StrEnum):
    """To which multiples of 8 widths are rounded."""

    H = "H"
    L = "L"


class Tuning(StrEnum):
    """What moves a neuron of a map after the first 100 epochs."""

    own = "own"
    neighbours = "neighbours"


def reduce(
    weights: Annotated[
        str,
        typer.Option(
            metavar="FILE", help="Weights of a DfD-Net: a file, or the name of shipped ones."
        ),
    ],
    dataset: Annotated[
        str, typer.Option(help="A data set's name or a store's path.")
    ] = "middlebury",
    split: Annotated[
        str, typer.Option(help="Sample the first pair of each scene of this split.")
    ] = "test",
    level: Annotated[
        int | None,
        typer.Option(help="Iterative rows F of level 1, 2 or 3, in place of the ensemble rows B."),
    ] = None,
    rounds: Annotated[
        Rounding | None, typer.Option(help="Also round to multiples of 8, up (H) or down (L).")
    ] = None,
    config: Configuration = "published",
    changes: Changes = None,
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Seed for the self-organising maps.")
    ] = 0,
    tuning: Annotated[
        Tuning,
        typer.Option(help="After 100 epochs a neuron follows its own inputs, or its neighbours'."),
    ] = Tuning.own,
    out: Annotated[
        str | None, typer.Option(help="Folder; default: training/DATASET-reduction/WEIGHTS.")
    ] = None,
    format: Annotated[Format, typer.Option(help="How the tables are printed.")] = Format.table,
    device: Device = "auto",
    threads: Threads = None,
    cache: Cache = None,
) -> None:
    """Count the different outputs of each layer; write configurations of narrower networks."""
    with needed():
        from dfdbench.methods.networks.inference import find_device
        from dfdbench.methods.networks.weights import find_weights
        from dfdbench.training.configuration import read_configuration
        from dfdbench.training.reduction.reduce import reduce_weights
    use_threads(threads)
    place = find_weights("dfd-net", weights)
    store = open_dataset(dataset, cache=cache)
    configuration = read_configuration(config, values_of(changes, "--set"))
    name = Path(weights).stem + (f"-level{level}" if level else "")
    default = Path("training") / f"{store.path.stem}-reduction" / name
    folder = output_place(default if out is None else out, place)
    with progress("training maps", "nothing was written") as bar:
        found = reduce_weights(
            place,
            store,
            configuration,
            split,
            level,
            rounds.value if rounds else None,
            seed,
            tuning.value,
            find_device(device),
            bar,
        )
    with writing(folder):
        found.write(folder)
    if format is Format.table:
        for table in found.tables:
            print_table(table)
    else:
        print(render(found.tables, format), end="")
    say(f"tables       {folder / 'counts.md'}, rows.md, and both as CSV")
    say(f"networks     {', '.join(found.files)} in {folder}")
    say(f"next         dfdbench thesis experiment reduction --dataset {dataset} --rows {folder}")
