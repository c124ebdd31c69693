"""The verb for depth maps that were made elsewhere: score."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

import typer

from dfdbench.cli.completion import data_sets
from dfdbench.cli.methods import folder_name, protocol_of_tables, submit_runs
from dfdbench.cli.options import Cache, FigureFormats, Replace, Submit
from dfdbench.cli.run_answer import print_run_tables, tell_overall, tell_where_it_lies
from dfdbench.cli.screen import progress, say
from dfdbench.results.output_place import output_place
from dfdbench.tables.table import Format


def score(
    predictions: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Folder of depth maps, npy, npz, PNG or TIFF: one file per pair, named as "
            "`dfdbench info NAME --pairs SPLIT` lists them.",
        ),
    ],
    dataset: Annotated[
        str, typer.Option(help="A data set's name or a store's path.", autocompletion=data_sets)
    ],
    split: Annotated[str, typer.Option(help="A split, a fold, a scene, or all.")] = "test",
    unit: Annotated[
        Literal["levels", "metres"],
        typer.Option(
            help="What arrays and TIFF files of floats hold. 8-bit images hold levels; 16-bit "
            "images levels times 256 or, with metres, millimetres."
        ),
    ] = "levels",
    method: Annotated[
        str | None, typer.Option(help="The method's name in tables; default: the folder's name.")
    ] = None,
    protocol: Annotated[
        str | None,
        typer.Option(
            help="Scoring protocol of the printed table; default: the data set's usual one."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; default: results/DATASET-SPLIT/METHOD-scored.")
    ] = None,
    format: Annotated[Format, typer.Option(help="How the tables are printed.")] = Format.table,
    cache: Cache = None,
    figure_format: FigureFormats = None,
    submit: Submit = False,
    replace: Replace = False,
) -> None:
    """Score depth maps that were made elsewhere, one file per pair; nothing is run."""
    from dfdbench.board.board import LEADERBOARD, require_leaderboard
    from dfdbench.datasets.dataset import open_dataset
    from dfdbench.datasets.integrity import require_sound
    from dfdbench.evaluation.scored import score_predictions
    from dfdbench.figures.runs import draw_run
    from dfdbench.metrics.protocol import find_protocol
    from dfdbench.results.summary import summarise

    asked = find_protocol(protocol).label if protocol else None
    if submit:
        require_leaderboard(LEADERBOARD)
    data = open_dataset(dataset, cache=cache)
    data.manifest.scenes_of(split)
    if submit:
        require_sound(data)
    shown = protocol_of_tables(asked, data)
    name = method or os.path.basename(os.path.realpath(predictions))
    default = Path("results") / f"{data.path.stem}-{split}" / f"{folder_name(name, None)}-scored"
    folder = output_place(out or default, predictions, str(data.path), replaces=True)
    with progress(f"scoring {name}", "the same command scores all of them anew") as step:
        done = score_predictions(predictions, data, split, folder, name, unit, step)
    if done.set_aside:
        say(f"what lay there was moved to {done.set_aside}")
    summary = summarise(done.result, shown)
    draw_run(data, summary, folder, also=figure_format or ())
    print_run_tables(summary, data.manifest, format)
    tell_where_it_lies(done, figures=True)
    if submit:
        submit_runs([done.result], replace)
    tell_overall(summary)
