"""What is tried: an input is a command line or a reader, and the files that it finds."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from tests.fuzz import mutation as m
from tests.fuzz.arguments import command_line
from tests.fuzz.bench import SEARCH, TRAIN, Bench
from tests.fuzz.readers import READERS


@dataclass(frozen=True)
class Given:
    """An input.

    Parameters
    ----------
    kind : str
        Its class.
    call : tuple of str
        The command line; or a reader's name in brackets, and the file that it reads.
    files : mapping of str to bytes
        What is put in place of sound files, or beside them.
    """

    kind: str
    call: tuple[str, ...]
    files: dict[str, bytes] = field(default_factory=dict)

    def as_json(self) -> str:
        """Return it as it is kept."""
        files = {name: _as_text(content) for name, content in self.files.items()}
        content = {"kind": self.kind, "call": self.call, "files": files}
        return json.dumps(content, indent=1) + "\n"

    @staticmethod
    def from_json(text: str) -> Given:
        """Return an input that was kept."""
        content = json.loads(text)
        files = {name: _as_bytes(kept) for name, kept in content["files"].items()}
        return Given(content["kind"], tuple(content["call"]), files)


def _as_text(content: bytes) -> dict[str, str]:
    # Readable where it can be: who mends it wants to see it.
    try:
        return {"text": content.decode("ascii")}
    except UnicodeDecodeError:
        return {"base64": base64.b64encode(content).decode()}


def _as_bytes(kept: dict[str, str]) -> bytes:
    return kept["text"].encode() if "text" in kept else base64.b64decode(kept["base64"])


_REPORTS = (
    "report ITEM --format table",
    "report ITEM --out page",
    "report ITEM --format markdown --out page",
    "report ITEM other --format latex",
    "compare ITEM other",
    "compare other ITEM --format json",
    "audit depths tiny.zarr --result ITEM",
    "audit coverage tiny.zarr --result ITEM",
)
_STORES = (
    "info ITEM",
    "info ITEM --pairs test",
    "verify ITEM --workers 1",
    "export ITEM --png png --split test",
    "run --method constant --dataset ITEM --out out --limit 2 --no-predictions",
    "audit depths ITEM",
    "audit coverage ITEM --train train --test test",
    "audit difficulty ITEM --split Two",
    "build tiny-1.toml --source site --store ITEM --workers 1",
)
# Without figures, which would take all of the time.
_AGAIN = "run --method constant --dataset tiny.zarr --out ITEM --no-predictions"
_SHOWN = (
    "audit depths tiny.zarr --result ITEM",
    "report ITEM --out page",
    "compare ITEM other --out panels.png",
)

#: By class: sound files, as patterns below the bench, one of which is changed as its suffix asks
#: for; and who reads it, command lines or readers in brackets, where `FILE` stands for the file and
#: `ITEM` for what it lies in.
KINDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "manifest": (
        "tiny-1.toml demo-1.toml mine-1.toml realworld-1.toml",
        ("info FILE", "info FILE --pairs all", "build FILE --source site --store out.zarr"),
    ),
    "manifest of captures": (
        "mine-1.toml",
        ("build FILE --source mine --store out.zarr --workers 1",),
    ),
    "store": (
        "tiny.zarr/zarr.json tiny.zarr/*/zarr.json tiny.zarr/*/*/zarr.json tiny.zarr/*/*/c*",
        _STORES,
    ),
    "result": ("run/result.json", _REPORTS),
    "predictions of a run": ("run/predictions.zarr/**/zarr.json", _SHOWN),
    "run to go on with": ("run/pairs.jsonl run/run.json run/store.txt", (_AGAIN,)),
    "fit": (
        "fitted/fit.npz",
        ("run --method mine.py:Fitted --dataset tiny.zarr --out fitted --no-predictions",),
    ),
    "depth maps": ("maps/**/*.npy maps/**/*.png maps/**/*.npz", ("[maps] FILE tiny.zarr",)),
    "leaderboard": (
        "board/results/*/*.json board/methods/*.toml board/*.json board/published/*.json",
        ("leaderboard --folder ITEM", "leaderboard --folder ITEM --format json"),
    ),
    "configuration": ("quick.toml", ("[configuration] FILE",)),
    "experiment": (
        "quick.toml",
        (
            "thesis experiment noise --dataset tiny.zarr --config FILE --values 1 --repeats 1 "
            "--max-time 1s --device cpu --threads 1 --out out",
        ),
    ),
    "weights": ("weights.safetensors", ("[weights] FILE",)),
    "training to go on with": ("training/checkpoint.pt", (TRAIN + " --resume",)),
    "search to go on with": (
        "search/positions.csv search/search.json",
        (SEARCH + " --max-time 1s",),
    ),
    "lens table": ("lens.csv", ("[lens] FILE", "rig optics pairs --lens FILE --range 1.5 2.2")),
    "beams": ("beams.csv", ("[beams] FILE",)),
    "ranges": ("ranges.bin ranges.npy", ("[ranges] FILE",)),
    "registration": ("registration.toml", ("[registration] FILE",)),
    "recipe": ("told.toml law.toml", ("[recipe] FILE",)),
    "PNG": ("sharp.png deep.png", ("[png-photograph] FILE",)),
    "photograph": ("sharp.png deep.png sharp.jpg sharp.tiff", ("[photograph] FILE",)),
    "PNG of depth": ("depth.png", ("[png-depth] FILE",)),
    "depth": ("depth.png depth.jpg depth.tiff", ("[depth] FILE",)),
    "archive": ("files.zip", ("[archive] FILE",)),
    "checksums": ("tiny-1.lock", ("[checksums] FILE",)),
}
#: The class that is no file of the bench.
ARGUMENTS = "arguments"
NAMES = (*KINDS, ARGUMENTS)
# They also compile, once, what takes longer than any of the spoiled ones may.
_SOUND_LINES = (
    "list",
    "doctor",
    "check-method local",
    "run --method graph-cuts --dataset tiny.zarr --split Two --limit 1 --out out",
    "score --predictions maps --dataset tiny.zarr --method mine --out out",
    "audit split tiny.zarr --test-scenes 1",
    "rig optics pairs --lens lens.csv --range 1.5 2.2",
)


def sound_inputs(name: str) -> range:
    """Return the numbers of the inputs of a class that are sound, and must succeed."""
    calls = _SOUND_LINES if name == ARGUMENTS else KINDS[name][1]
    return range(1 - len(calls), 1)


def make(name: str, seed: int, number: int, bench: Bench) -> Given:
    """Return an input of a class by its number; from 1 on they are spoiled."""
    random, sound = Random(f"{seed}/{name}/{number}"), number <= 0
    if name == ARGUMENTS:
        return Given(name, tuple(_SOUND_LINES[-number].split() if sound else command_line(random)))
    patterns, calls = KINDS[name][0].split(), KINDS[name][1]
    pattern = patterns[0] if sound else random.choice(patterns)
    item = bench.item(pattern.partition("/")[0])
    below = pattern.partition("/")[2]
    files = sorted(f for f in item.glob(below) if f.is_file()) if below else [item]
    file = files[0] if sound else random.choice(files)
    call = calls[-number] if sound else random.choice(calls)
    place, content = file.relative_to(bench.place).as_posix(), file.read_bytes()
    words = [w.replace("FILE", place).replace("ITEM", item.name) for w in call.split()]
    change = m.CHANGES.get(file.suffix, m.changed_bytes)
    return Given(name, tuple(words), {place: content if sound else change(random, content)})


def is_reader(call: tuple[str, ...]) -> bool:
    """Return whether an input calls a reader and not the command line."""
    return call[0].strip("[]") in READERS and call[0].startswith("[")


def read(call: tuple[str, ...], folder: Path) -> None:
    """Call an input's reader on its file."""
    READERS[call[0].strip("[]")](folder / call[1])
