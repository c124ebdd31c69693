"""The verbs for the leaderboard: write it, check it, verify a result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dfdbench.board_folder import LEADERBOARD
from dfdbench.board_tables import ranking_table
from dfdbench.cli.screen import print_table, progress, say
from dfdbench.errors import InputError, Problem, ResultError
from dfdbench.leaderboard import boards, collect
from dfdbench.leaderboard_readme import check_readme, write_readme
from dfdbench.result import RESULT, load_result
from dfdbench.store import open_store
from dfdbench.submission import data_set_problems
from dfdbench.tables import Format, render
from dfdbench.verification import SUFFIX, save_verification, verify

app = typer.Typer(invoke_without_command=True, add_completion=False, rich_markup_mode=None)
Folder = Annotated[Path, typer.Option(help="The leaderboard's folder.")]


@app.callback()
def leaderboard(
    context: typer.Context,
    check: Annotated[
        bool, typer.Option("--check", help="Change nothing; fail where a file is wrong or stale.")
    ] = False,
    format: Annotated[
        Format | None, typer.Option(help="How the rankings are printed; default: table.")
    ] = None,
    folder: Folder = LEADERBOARD,
) -> None:
    """Rank the results of the leaderboard, print the rankings and write its README."""
    if context.invoked_subcommand:
        return
    if check and format:
        raise InputError(
            Problem("--check prints no rankings", f"--format {format}", fix="leave out one of them")
        )
    if check:
        print(f"{folder}: {check_readme(folder)} results valid, README up to date")
        return
    found = boards(collect(folder))
    path = write_readme(folder)
    tables = [ranking_table(board, folder) for board in found]
    if format is None or format is Format.table:
        for table in tables:
            print_table(table)
    else:
        print(render(tables, format), end="")
    say(f"written      {path}")


@app.command("verify")
def verify_command(
    results: Annotated[list[Path], typer.Argument(help="Result files.")],
    pairs: Annotated[int, typer.Option(min=1, help="How many pairs are run again.")] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Of the random sample.")] = 0,
    tolerance: Annotated[
        float, typer.Option(min=0, help="How far a score may be off where depth maps differ.")
    ] = 1e-3,
    dataset: Annotated[
        str | None, typer.Option(help="A store's path; default: the data set that it names.")
    ] = None,
    record: Annotated[
        bool, typer.Option("--record", help="Write what was found beside the result.")
    ] = False,
    folder: Folder = LEADERBOARD,
) -> None:
    """Run a random sample of each result's pairs again and compare."""
    # Given by a pattern, earlier verifications are among the files.
    for path in (path for path in results if not path.name.endswith(SUFFIX)):
        _verify_one(path, folder, dataset, (pairs, seed, tolerance), record)


def _verify_one(
    path: Path, folder: Path, dataset: str | None, how: tuple[int, int, float], record: bool
) -> None:
    path = path / RESULT if path.is_dir() else path
    claimed = load_result(path)
    problems = data_set_problems(claimed, folder, str(path))
    if problems:
        raise ResultError(problems)
    store = open_store(dataset or claimed.dataset.name)
    with progress(f"verifying {claimed.method.name}") as step:
        found = verify(claimed, path, store, *how, on_pair=step)
    count = len(found.pairs)
    print(f"verified     {path}")
    print(f"pairs        {count} of {claimed.dataset.evaluated}: {', '.join(found.pairs)}")
    print(f"identical    {found.identical} of {count} depth maps")
    if found.identical < count:
        print(f"scores       at most {found.largest_difference:.2g} off, {how[2]:g} allowed")
    if not found.same_source:
        say("the method's source file is not the one that the result was made with")
    if record:
        say(f"recorded     {save_verification(found, path)}")
