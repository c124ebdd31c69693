"""The verbs for the leaderboard: write it, check it, verify a row."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dfdbench.board.board import LEADERBOARD
from dfdbench.board.board import leaderboard as open_board
from dfdbench.board.row_file import read_row
from dfdbench.board.verification import SCORE_TOLERANCE, verify
from dfdbench.cli.screen import print_tables, progress, say
from dfdbench.errors import InputError
from dfdbench.tables.table import Format, counted

app = typer.Typer(invoke_without_command=True, add_completion=False, rich_markup_mode=None)


@app.callback()
def leaderboard(
    context: typer.Context,
    check: Annotated[
        bool, typer.Option("--check", help="Change nothing; fail if a file is wrong or stale.")
    ] = False,
    format: Annotated[
        Format | None, typer.Option(help="How the rankings are printed; default: table.")
    ] = None,
    folder: Annotated[Path, typer.Option(help="The leaderboard's folder.")] = LEADERBOARD,
) -> None:
    """Rank the results of the leaderboard, print the rankings and write its README."""
    if context.invoked_subcommand:
        return
    if check and format:
        raise InputError(
            "--check prints no rankings", where=f"--format {format}", fix="leave out one of them"
        )
    board = open_board(folder)
    if check:
        board.require_written()
        print(f"{folder}: {counted(len(board.rows), 'row')} valid, README up to date")
        return
    path = board.write()
    print_tables(board.tables(), format)
    say(f"written      {path}")


@app.command("verify")
def verify_command(
    rows: Annotated[list[Path], typer.Argument(help="Files of leaderboard/results.")],
    pairs: Annotated[int, typer.Option(min=1, help="How many pairs are run again.")] = 5,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, max=2**32 - 1, help="Repeat the draw of this seed; default: a new draw."
        ),
    ] = None,
    tolerance: Annotated[
        float, typer.Option(help="How far a score may be off, 0 to 1.")
    ] = SCORE_TOLERANCE,
    trust: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ENTRY",
            help="Allow this method's code, which is not built in, to be run; repeatable.",
        ),
    ] = None,
    weights: Annotated[
        Path | None, typer.Option(help="Your copy of weights that are not shipped.")
    ] = None,
) -> None:
    """Run pairs of rows again, drawn anew each time; exit with 1 if something else comes out."""
    failed = False
    for path in rows:
        row = read_row(path)
        if row.method.scored:
            say(f"left out     {path}: scored, not run: there is nothing to run again")
            continue
        with progress(f"verifying {row.label}", "the same command draws anew") as step:
            found = verify(row, path, pairs, seed, tolerance, trust or (), weights, step)
        print(f"{'verified' if found.passed else 'DIFFERS':<12} {path}")
        print(f"drawn        {len(found.pairs)} of {found.drawn_from} pairs by --seed {found.seed}")
        for pair in found.pairs:
            print(f"{'same' if pair.passes(tolerance) else 'DIFFERENT':<12} {pair}")
        if not found.same_source:
            say("the method's source file is not the one that the row was made with")
        failed |= not found.passed
    if failed:
        raise typer.Exit(1)
