"""Run the leaderboard's rows anew on the data sets that are built here, and write its README.

What cannot be run is left as it is and named at the end: `python leaderboard/rerun.py [ROWS.toml]`.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

from dfdbench.blur.tracks import TRACKS
from dfdbench.board.board import LEADERBOARD
from dfdbench.board.row_file import RESULTS
from dfdbench.building.sources import is_made
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import open_dataset
from dfdbench.errors import StoreError

HERE = Path(__file__).parent
#: How the rows of each kind are run.
_RUN = {"sets": ("run", "--no-predictions"), "tracks": ("tracks",)}
_TRACKS = [
    f"{track.name}-{severity}"
    for track in TRACKS.values()
    for severity in range(1, len(track.severities) + 1)
]


def main(rows: Path) -> int:
    """Run, verify and write; return the exit status."""
    left_out: list[str] = []
    run_here: dict[tuple[str, str], None] = {}
    listed = tomllib.loads(rows.read_text(encoding="utf-8"))
    for kind, wanted in [(name, each) for name in _RUN for each in listed.get(name, [])]:
        name = wanted["dataset"]
        made = is_made(find_manifest(name))
        if made and _lacking(name, "all"):
            _dfdbench("build", name)
        for split in wanted["splits"]:
            # The tracks of a set that is made are built where they are first run.
            tracks = _TRACKS if kind == "tracks" and not made else ()
            needed = (name, *(f"{name}@{track}" for track in tracks))
            lacking = next(filter(None, (_lacking(each, split) for each in needed)), "")
            if lacking:
                left_out += [f"{name}, split {split}, {m}: {lacking}" for m in wanted["methods"]]
                continue
            run = (*_RUN[kind], "--dataset", name, "--split", split, "--submit")
            for method in wanted["methods"]:
                if _dfdbench(*run, "--method", *shlex.split(method)):
                    left_out.append(f"{name}, split {split}, {method}: failed, see above")
            run_here[name, split] = None
    for name, split in run_here:
        board = f"{open_dataset(name).manifest.stem}-{split}"
        files = sorted((LEADERBOARD / RESULTS / board).glob("*.json"))
        _dfdbench("leaderboard", "verify", *map(str, files))
    status = _dfdbench("leaderboard")
    for text in left_out:
        print(f"left out     {text}", file=sys.stderr)
    return status


def _lacking(name: str, split: str) -> str:
    """Say why a split cannot be run here; empty where it can."""
    try:
        store = open_dataset(name)
    except StoreError as error:
        return f"{error.problems[0].what}; {error.problems[0].fix}"
    there = set(store.pairs(split))
    missing = [pair.id for pair in store.manifest.pairs(split) if pair not in there]
    return f"the store lacks {', '.join(missing)}" if missing else ""


def _dfdbench(*words: str) -> int:
    print(f"\n== dfdbench {shlex.join(words[:9])}{' ...' if len(words) > 9 else ''}", flush=True)
    return subprocess.run([sys.executable, "-m", "dfdbench", *words], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "rows.toml"))
