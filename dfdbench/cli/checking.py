"""The verb that tries a method before it is run: check-method."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer

from dfdbench.cli.completion import methods
from dfdbench.cli.methods import Params
from dfdbench.cli.options import values_of
from dfdbench.cli.screen import print_table
from dfdbench.tables.table import Table
from dfdbench.tables.wording import counted


def check_method_command(
    method: Annotated[
        str,
        typer.Argument(
            help="As for `run --method`: a name, file.py:function or module:function.",
            autocompletion=methods,
        ),
    ],
    param: Params = None,
) -> None:
    """Try a method on awkward inputs and say what is wrong, before a long run."""
    from dfdbench.blur.recipe import RECIPES
    from dfdbench.datasets.depth_scale import Rig
    from dfdbench.methods.check import check_method
    from dfdbench.methods.registry import load_method

    offers: dict[str, Callable[[], Any]] = {
        "recipe": lambda: RECIPES["published"],
        "recipe_name": lambda: "published",
        "training_mean": lambda: 128.0,
        "seed": lambda: 0,
        "rig": Rig,
    }
    # A class with a fit has to find out the blur, so that the fit is tried too.
    for_fits = {"recipe": lambda: None}
    trials = check_method(load_method(method, values_of(param, "--param"), offers, for_fits))
    rows = tuple(
        (
            "FAIL" if trial.error else "odd" if trial.warning else "ok",
            trial.name,
            f"{trial.seconds:.3f} s",
            trial.error or trial.warning,
        )
        for trial in trials
    )
    columns = ("", "input", "time", "what is wrong")
    print_table(Table(f"{method} on awkward inputs", columns, rows, "llrl"))
    failed = sum(bool(trial.error) for trial in trials)
    if failed:
        print(f"{failed} of {counted(len(trials), 'trial')} failed")
        raise typer.Exit(1)
    odd = sum(bool(trial.warning) for trial in trials)
    print("fit for a run" + (f", {counted(odd, 'warning')}" if odd else ""))
