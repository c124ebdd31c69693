"""Run every method that has a card on rooms of a seed, and write the leaderboard's README.

`python leaderboard/rerun.py` draws a seed from the system's randomness, `--seed N` names one, and
`--rows` instead runs anew the rows that are there. Both name at the end what they left out.
"""

from __future__ import annotations

import argparse
import datetime
import json
import secrets
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from dfdbench.blur.tracks import CLEAN, SUITES
from dfdbench.board import LEADERBOARD
from dfdbench.board.board import SEEDS, Draw, read_draws
from dfdbench.board.cards import Card, load_cards
from dfdbench.board.row_file import RESULTS
from dfdbench.datasets.catalog import of_seed
from dfdbench.datasets.dataset import open_dataset
from dfdbench.errors import DfdbenchError, ResultError, StoreError
from dfdbench.results import environment
from dfdbench.statuses import INTERRUPTED, MISTAKE
from dfdbench.system.files import write_whole
from dfdbench.system.text import parse_json

_FAMILIES = {"pair": "unseen", "stack": "unseen-stack"}
#: Scores alone, no figures and no depth maps.
_ALONE = ("--no-predictions", "--no-figures")
#: Seeds are drawn below this: nobody can try so many.
_MOST = 10**18


def draw_seed(folder: Path, seed: int | str | None = None) -> Draw:
    """Write down a seed with today's date and the commit, before anything is run on it.

    One that was written down before stays as it is.

    Parameters
    ----------
    folder : Path
        The leaderboard's folder.
    seed : int or str, optional
        By default drawn from the system's randomness.

    Raises
    ------
    InputError
        If it is no seed.
    ResultError
        If code or a card was changed since the last commit, so that no commit says what is run.
    """
    commit = environment.describe_environment().git
    # A row's commit says nothing of cards and of new modules.
    asked = ["git", "-C", str(folder), "status", "--porcelain", "--", "methods", ":/*.py"]
    found = subprocess.run(asked, check=False, capture_output=True, text=True) if commit else None
    changed = found.stdout.splitlines() if found else []
    if commit is None or commit.endswith("-dirty") or changed:
        fix = "commit it first: the board says which commit was run"
        where = changed[0][3:] if changed else commit or "no git checkout"
        raise ResultError("the code that is to be run is in no commit", where=where, fix=fix)
    number = secrets.randbelow(_MOST) if seed is None else int(of_seed("unseen", seed)[7:])
    earlier = read_draws(folder)
    if before := next((draw for draw in earlier if draw.seed == number), None):
        return before
    draw = Draw(seed=number, drawn=seed is None, date=datetime.date.today(), commit=commit)
    content = [json.dumps(each.model_dump(mode="json")) for each in (draw, *earlier)]
    write_whole(folder / SEEDS, "[\n " + ",\n ".join(content) + "\n]\n")
    return draw


def run_seed(seed: str | None, limit: float) -> Iterator[str]:
    """Build the sets of a seed and run all cards on them; yield what was left out, and why.

    Parameters
    ----------
    seed : str or None
        None for a new one, which is written down with date and commit before anything is run.
    limit : float
        Minutes after which a method is stopped.
    """
    draw = draw_seed(LEADERBOARD, seed)
    print(f"seed         {draw.seed}, written down {draw.date} at commit {draw.commit}")
    print(f"if stopped   make leaderboard SEED={draw.seed} goes on", flush=True)
    cards = {name: card for name, card in load_cards(LEADERBOARD).items() if not card.given_blur}
    for takes, family in _FAMILIES.items():
        methods = {name: card for name, card in cards.items() if takes in card.takes}
        if not methods:
            continue
        if _dfdbench("build", family, "--seed", str(draw.seed)):
            yield f"{family}: not built, see above"
            continue
        for name, card in methods.items():
            run: tuple[str, ...] = ("run", *_ALONE, "--dataset", f"{family}-{draw.seed}")
            if why := _run(run, card, limit):
                yield f"{family}, {name}: {why}"


def run_rows(limit: float) -> Iterator[str]:
    """Run anew the rows that are there, where their sets are built; yield what was left out."""
    cards = load_cards(LEADERBOARD)
    for path in sorted((LEADERBOARD / RESULTS).rglob("*.json")):
        row = parse_json(path.read_text("utf-8"))
        name, split, card = row["dataset"], row["split"], cards.get(path.stem)
        if card is None:
            yield f"{path}: no card of this name"
            continue
        for suite in row["suites"]:
            labels = SUITES.get(suite, (CLEAN,))
            places = [name if label == CLEAN else f"{name}@{label}" for label in labels]
            run: tuple[str, ...] = ("run", *_ALONE, "--dataset", places[0])
            if len(places) > 1:
                run = ("tracks", "--dataset", name)
            why = next(filter(None, (_lacking(place, split) for place in places)), "")
            if why := why or _run((*run, "--split", split), card, limit):
                yield f"{path}, {suite}: {why}"


def _run(words: tuple[str, ...], card: Card, limit: float) -> str:
    method = card.arguments(on_tracks=words[0] == "tracks")
    try:
        status = _dfdbench(*words, "--submit", *method, limit=limit)
    except subprocess.TimeoutExpired:
        return f"stopped after {limit:g} minutes"
    return "failed, see above" if status else ""


def _lacking(name: str, split: str) -> str:
    """Say why a split cannot be run here; empty if it can."""
    try:
        store = open_dataset(name)
    except StoreError as error:
        return f"{error.problems[0].what}; {error.problems[0].fix}"
    there = set(store.pairs(split))
    missing = [pair.id for pair in store.manifest.pairs(split) if pair not in there]
    return f"the store lacks {', '.join(missing)}" if missing else ""


def _dfdbench(*words: str, limit: float | None = None) -> int:
    print(f"\n== dfdbench {shlex.join(words)}", flush=True)
    command = [sys.executable, "-m", "dfdbench", *words]
    return subprocess.run(command, check=False, timeout=limit and 60 * limit).returncode


def main() -> int:
    """Run, write and say what was left out; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--seed", help="default: drawn from the system's randomness")
    which.add_argument("--rows", action="store_true", help="run the rows that are there anew")
    parser.add_argument("--minutes", type=float, default=60, help="a method's limit; default: 60")
    asked = parser.parse_args()
    left = list[str]()
    try:
        for text in run_rows(asked.minutes) if asked.rows else run_seed(asked.seed, asked.minutes):
            left.append(text)
        status = _dfdbench("leaderboard", "--format", "csv")
    except DfdbenchError as error:
        print(f"error: {error}", file=sys.stderr)
        status = MISTAKE
    except KeyboardInterrupt:
        status = INTERRUPTED
    for text in left:
        print(f"left out     {text}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
