"""The seeds that the leaderboard was run on, with the date and the commit of each run."""

import datetime
import json
import secrets
from pathlib import Path

from pydantic import TypeAdapter

from dfdbench.board.row_file import read_list
from dfdbench.datasets.catalog import of_seed
from dfdbench.errors import ResultError
from dfdbench.results.environment import describe_environment
from dfdbench.results.record import Line
from dfdbench.system.files import write_whole
from dfdbench.system.strict import Record

SEEDS = "seeds.json"
#: Seeds are drawn below this: nobody can try so many.
_MOST = 10**18


class Draw(Record):
    """A seed, when the methods were run on it and at which commit.

    Without `drawn` it was named, not drawn: whoever named it may have tried others.
    """

    seed: int
    drawn: bool
    date: datetime.date
    commit: Line


def read_draws(folder: Path) -> list[Draw]:
    """Return a leaderboard's seeds, the newest first.

    Raises
    ------
    ResultError
        If the file cannot be read.
    """
    return read_list(folder / SEEDS, TypeAdapter(list[Draw]), "seeds") or []


def draw_seed(folder: Path, seed: int | str | None = None) -> Draw:
    """Write down a seed with today's date and the commit, before anything is run on it.

    Parameters
    ----------
    folder : Path
        The leaderboard's folder.
    seed : int or str, optional
        By default drawn from the system's randomness. One that was drawn before stays drawn if
        the commit is the same.

    Raises
    ------
    InputError
        If it is no seed.
    ResultError
        If code was changed since the last commit, so that no commit says what is run.
    """
    commit = describe_environment().git
    if commit is None or commit.endswith("-dirty"):
        fix = "commit it first: the board says which commit was run"
        where = commit or "no git checkout"
        raise ResultError("the code that is to be run is in no commit", where=where, fix=fix)
    number = secrets.randbelow(_MOST) if seed is None else int(of_seed("unseen", seed)[7:])
    earlier = read_draws(folder)
    before = next((draw for draw in earlier if draw.seed == number), None)
    if before and before.commit == commit:
        return before
    draw = Draw(seed=number, drawn=seed is None, date=datetime.date.today(), commit=commit)
    others = [each for each in earlier if each.seed != number]
    content = [json.dumps(each.model_dump(mode="json")) for each in (draw, *others)]
    write_whole(folder / SEEDS, "[\n " + ",\n ".join(content) + "\n]\n")
    return draw
