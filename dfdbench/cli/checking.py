"""The verb that tries a method before it is run: check-method."""

from __future__ import annotations

from functools import partial
from typing import Annotated

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
    from dfdbench.evaluation.loading import load_to_check
    from dfdbench.methods.check import check_method

    load = partial(load_to_check, method, values_of(param, "--param"))
    trials = check_method(load(), load=load)
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
