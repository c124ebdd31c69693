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
from dfdbench.leaderboard.boards import parted
from dfdbench.leaderboard.claimed_method import ClaimedMethod
from dfdbench.leaderboard.data_set_problems import data_set_problems
from dfdbench.leaderboard.folder import LEADERBOARD
from dfdbench.leaderboard.readme import check_readme, collect_all, write_readme
from dfdbench.leaderboard.scored_table import scored_table
from dfdbench.leaderboard.track_board_tables import tracks_board_table
from dfdbench.leaderboard.track_boards import track_boards
from dfdbench.leaderboard.tracks_submission import is_tracks_file, read_tracks, runs_problems
from dfdbench.leaderboard.verification import claim_of, verify_result, verify_tracks
from dfdbench.leaderboard.verification_file import (
    SCORE_TOLERANCE,
    SUFFIX,
    VerifiedSample,
    save_verification,
)
from dfdbench.results.record import SCORED, Result
from dfdbench.results.record_file import RESULT, load_result
from dfdbench.results.tracks_record import results_of
from dfdbench.tables.render import render
from dfdbench.tables.table import Format
from dfdbench.tables.wording import counted

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
        print(f"{folder}: {counted(check_readme(folder), 'result')} valid, README up to date")
        return
    entries, tracked = collect_all(folder)
    found, scored = parted(entries)
    path = write_readme(folder)
    tables = [standings_table(board, folder) for board in found]
    tables += [tracks_board_table(board, folder) for board in track_boards(tracked)]
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
    seed: Annotated[
        int, typer.Option(min=0, max=2**32 - 1, help="Seed for drawing the pairs.")
    ] = 0,
    tolerance: Annotated[
        float, typer.Option(help="How far a score may be off where depth maps differ, 0 to 1.")
    ] = SCORE_TOLERANCE,
    dataset: Annotated[
        str | None, typer.Option(help="A store's path; default: the data set that it names.")
    ] = None,
    record: Annotated[
        bool,
        typer.Option(
            "--record", help="Write a file beside the result that says it was reproduced."
        ),
    ] = False,
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
        runs = _read(path, folder, dataset)
        claimed = next(iter(runs.values()))
        if claimed.method.scored:
            say(f"left out     {path}: {SCORED}: there is nothing to run again")
            continue
        trusted = consent.to(claim_of(claimed, path), path)
        how = (pairs, seed, tolerance, trusted, weights)
        with progress(f"verifying {claimed.method.name}", "the same command verifies anew") as step:
            if is_tracks_file(path):
                found = verify_tracks(runs, path, open_store, *how, on_pair=step)
            else:
                store = open_store(dataset or claimed.dataset.name)
                found = verify_result(claimed, path, store, *how, on_pair=step)
        _tell(found, sum(run.dataset.evaluated for run in runs.values()), path, tolerance)
        if record:
            say(f"recorded     {save_verification(found, seed, path)}")


def _read(path: Path, folder: Path, dataset: str | None) -> dict[str, Result]:
    """Return the runs that a file holds: those on tracks by track, else the only one."""
    if not is_tracks_file(path):
        claimed = load_result(path)
        problems = data_set_problems(claimed, folder, str(path))
        if problems:
            raise ResultError.of(problems)
        return {claimed.dataset.degradation: claimed}
    if dataset is not None:
        raise InputError(
            "the runs are on several data sets: a track each",
            where=f"--dataset {dataset}",
            fix="leave it out; the stores are found by name",
        )
    # A reviewer's copy lies elsewhere: where it belongs is for the leaderboard's check.
    results = results_of(read_tracks(path))
    problems = runs_problems(results, path, folder)
    if problems:
        raise ResultError.of(problems)
    return results


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


def _tell(found: VerifiedSample, evaluated: int, path: Path, tolerance: float) -> None:
    count = len(found.pairs)
    print(f"reproduced   {path}")
    print(f"pairs        {count} of {evaluated}: {', '.join(found.pairs)}")
    print(f"identical    {found.identical} of {count} depth maps")
    if found.identical < count:
        print(f"scores       at most {found.largest_difference:.2g} off, {tolerance:g} allowed")
    if not found.same_source:
        say("the method's source file is not the one that the result was made with")
