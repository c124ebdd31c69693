"""The verbs for the leaderboard: write it, check it, verify a result."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from dfdbench.cli.screen import print_table, progress, say
from dfdbench.datasets.store import open_store
from dfdbench.errors import InputError, ResultError
from dfdbench.leaderboard.board_tables import standings_table
from dfdbench.leaderboard.boards import collect, parted
from dfdbench.leaderboard.claimed_method import ClaimedMethod
from dfdbench.leaderboard.data_set_problems import data_set_problems
from dfdbench.leaderboard.folder import LEADERBOARD
from dfdbench.leaderboard.readme import check_readme, write_readme
from dfdbench.leaderboard.scored_table import scored_table
from dfdbench.leaderboard.verification import claim_of, verify_result
from dfdbench.leaderboard.verification_file import (
    SCORE_TOLERANCE,
    SUFFIX,
    VerifiedSample,
    save_verification,
)
from dfdbench.results.record import SCORED, Result
from dfdbench.results.record_file import RESULT, load_result
from dfdbench.tables.render import render
from dfdbench.tables.table import Format

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
            "--check prints no rankings", where=f"--format {format}", fix="leave out one of them"
        )
    if check:
        print(f"{folder}: {check_readme(folder)} results valid, README up to date")
        return
    found, scored = parted(collect(folder))
    path = write_readme(folder)
    tables = [standings_table(board, folder) for board in found]
    tables += [scored_table(board, folder) for board in scored]
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
    seed: Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Of the random sample.")] = 0,
    tolerance: Annotated[
        float, typer.Option(help="How far a score may be off where depth maps differ, 0 to 1.")
    ] = SCORE_TOLERANCE,
    dataset: Annotated[
        str | None, typer.Option(help="A store's path; default: the data set that it names.")
    ] = None,
    record: Annotated[
        bool, typer.Option("--record", help="Write beside the result that it was reproduced.")
    ] = False,
    trust: Annotated[
        list[str] | None,
        typer.Option(metavar="ENTRY", help="Code, not built in, that may be run; repeatable."),
    ] = None,
    weights: Annotated[
        Path | None, typer.Option(help="Your copy of weights that are not shipped.")
    ] = None,
    folder: Folder = LEADERBOARD,
) -> None:
    """Run a random sample of each result's pairs again; the same numbers are reproduced."""
    if record and tolerance != SCORE_TOLERANCE:
        raise InputError(
            what="what is recorded was found with the released tolerance",
            where="--tolerance",
            expected=f"{SCORE_TOLERANCE:g}",
            got=f"{tolerance:g}",
            fix="leave out --tolerance, or --record",
        )
    consent = _Consent(list(trust or []))
    # Given by a pattern, earlier verifications are among the files.
    for path in (path for path in results if not path.name.endswith(SUFFIX)):
        path = path / RESULT if path.is_dir() else path
        claimed = load_result(path)
        if claimed.method.scored:
            say(f"left out     {path}: {SCORED}: there is nothing to run again")
            continue
        problems = data_set_problems(claimed, folder, str(path))
        if problems:
            raise ResultError.of(problems)
        trusted = consent.to(claim_of(claimed, path), path)
        store = open_store(dataset or claimed.dataset.name)
        with progress(f"verifying {claimed.method.name}") as step:
            found = verify_result(
                claimed, path, store, pairs, seed, tolerance, trusted, weights, on_pair=step
            )
        _tell(found, claimed, path, tolerance)
        if record:
            say(f"recorded     {save_verification(found, seed, path)}")


class _Consent:
    """What the user agreed to run, by option or when asked."""

    def __init__(self, trusted: list[str]) -> None:
        self._trusted = trusted
        self._agreed: set[str] = set()

    def to(self, claim: ClaimedMethod, path: Path) -> list[str]:
        """Return the entries that may be imported for a result; ask where there is a terminal."""
        asks = claim.file is not None and claim.record.entry not in self._trusted
        if not asks or not (sys.stdin.isatty() and sys.stderr.isatty()):
            claim.require_consent(self._trusted, path)
            return self._trusted
        if str(claim) not in self._agreed:
            say(f"{path}\n{claim}")
            if not typer.confirm("Run this code?", err=True):
                claim.require_consent((), path)
            self._agreed.add(str(claim))
        return [claim.record.entry]


def _tell(found: VerifiedSample, claimed: Result, path: Path, tolerance: float) -> None:
    count = len(found.pairs)
    print(f"reproduced   {path}")
    print(f"pairs        {count} of {claimed.dataset.evaluated}: {', '.join(found.pairs)}")
    print(f"identical    {found.identical} of {count} depth maps")
    if found.identical < count:
        print(f"scores       at most {found.largest_difference:.2g} off, {tolerance:g} allowed")
    if not found.same_source:
        say("the method's source file is not the one that the result was made with")
