"""What is tried: an input is a command line or a reader, and the files that it finds."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from tests.fuzz import mutation as m
from tests.fuzz.arguments import command_line
from tests.fuzz.bench import SEARCH, TRAIN, Bench
from tests.fuzz.readers import READERS

Change = Callable[[Random, bytes], bytes]


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


@dataclass(frozen=True)
class Kind:
    """A class of inputs: which files are changed how, and who reads them.

    Parameters
    ----------
    files : tuple of str
        Sound files, as patterns below the bench; one of them is changed.
    change : callable
        Makes a file's new content of its old one.
    calls : tuple of str
        Command lines, or readers in brackets; `FILE` stands for the file, `ITEM` for what it lies
        in.
    """

    files: tuple[str, ...]
    change: Change
    calls: tuple[str, ...]

    def make(self, name: str, bench: Bench, random: Random, sound: int | None) -> Given:
        """Return an input: that of a call and the sound file, or a spoiled one."""
        pattern = random.choice(self.files) if sound is None else self.files[0]
        item = bench.item(pattern.partition("/")[0])
        below = pattern.partition("/")[2]
        files = sorted(f for f in item.glob(below) if f.is_file()) if below else [item]
        file = random.choice(files) if sound is None else files[0]
        place = file.relative_to(bench.place).as_posix()
        content = file.read_bytes()
        call = random.choice(self.calls) if sound is None else self.calls[sound]
        words = [w.replace("FILE", place).replace("ITEM", item.name) for w in call.split()]
        changed = self.change(random, content) if sound is None else content
        return Given(name, tuple(words), {place: changed})


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
_MAPS = ("[maps] FILE tiny.zarr",)
_BOARD = ("leaderboard --folder ITEM", "leaderboard --folder ITEM --format json")
# Without figures, which would take all of the time.
_AGAIN = "run --method constant --dataset tiny.zarr --out ITEM --no-predictions"
_SHOWN = (
    "audit depths tiny.zarr --result ITEM",
    "report ITEM --out page",
    "compare ITEM other --out panels.png",
)

KINDS: dict[str, Kind] = {
    "manifest": Kind(
        ("tiny-1.toml", "demo-1.toml", "mine-1.toml", "realworld-1.toml"),
        m.changed_toml,
        ("info FILE", "info FILE --pairs all", "build FILE --source site --store out.zarr"),
    ),
    "manifest of captures": Kind(
        ("mine-1.toml",), m.changed_toml, ("build FILE --source mine --store out.zarr --workers 1",)
    ),
    "store": Kind(("tiny.zarr/zarr.json", "tiny.zarr/*/zarr.json"), m.changed_json, _STORES),
    "array of a store": Kind(("tiny.zarr/*/*/zarr.json",), m.changed_json, _STORES),
    "chunk of a store": Kind(("tiny.zarr/*/*/c/**/[0-9]",), m.changed_bytes, _STORES),
    "result": Kind(("run/result.json",), m.changed_json, _REPORTS),
    "predictions of a run": Kind(("run/predictions.zarr/**/zarr.json",), m.changed_json, _SHOWN),
    "run to go on with": Kind(
        ("run/pairs.jsonl", "run/run.json", "run/store.txt"), m.changed_bytes, (_AGAIN,)
    ),
    "fit": Kind(
        ("fitted/fit.npz",),
        m.changed_bytes,
        ("run --method mine.py:Fitted --dataset tiny.zarr --out fitted --no-predictions",),
    ),
    "depth maps": Kind(("maps/**/*.npy",), m.changed_npy, _MAPS),
    "depth maps as images": Kind(("maps/**/*.png", "maps/**/*.np[yz]"), m.changed_bytes, _MAPS),
    "leaderboard": Kind(("board/results/*/*.json",), m.changed_json, _BOARD),
    "card of a method": Kind(("board/methods/*.toml",), m.changed_toml, _BOARD),
    "lists of the leaderboard": Kind(
        ("board/*.json", "board/published/*.json"), m.changed_json, _BOARD
    ),
    "configuration": Kind(("quick.toml",), m.changed_toml, ("[configuration] FILE",)),
    "experiment": Kind(
        ("quick.toml",),
        m.changed_toml,
        (
            "thesis experiment noise --dataset tiny.zarr --config FILE --values 1 --repeats 1 "
            "--max-time 1s --device cpu --threads 1 --out out",
        ),
    ),
    "weights": Kind(("weights.safetensors",), m.changed_bytes, ("[weights] FILE",)),
    "training to go on with": Kind(
        ("training/checkpoint.pt",), m.changed_bytes, (TRAIN + " --resume",)
    ),
    "search to go on with": Kind(
        ("search/positions.csv", "search/search.json"),
        lambda random, content: (
            m.changed_json(random, content)
            if content[:1] == b"{"
            else m.of_text(m.changed_cells)(random, content)
        ),
        (SEARCH + " --max-time 1s",),
    ),
    "lens table": Kind(
        ("lens.csv",),
        m.of_text(m.changed_cells),
        ("[lens] FILE", "rig optics pairs --lens FILE --range 1.5 2.2"),
    ),
    "beams": Kind(("beams.csv",), m.of_text(m.changed_cells), ("[beams] FILE",)),
    "ranges": Kind(("ranges.bin",), m.changed_bytes, ("[ranges] FILE",)),
    "ranges as an array": Kind(("ranges.npy",), m.changed_npy, ("[ranges] FILE",)),
    "registration": Kind(("registration.toml",), m.changed_toml, ("[registration] FILE",)),
    "recipe": Kind(("told.toml", "law.toml"), m.changed_toml, ("[recipe] FILE",)),
    "PNG": Kind(("sharp.png", "deep.png"), m.changed_bytes, ("[png-photograph] FILE",)),
    "photograph": Kind(
        ("sharp.png", "deep.png", "sharp.jpg", "sharp.tiff"),
        m.changed_bytes,
        ("[photograph] FILE",),
    ),
    "PNG of depth": Kind(("depth.png",), m.changed_bytes, ("[png-depth] FILE",)),
    "depth": Kind(("depth.png", "depth.jpg", "depth.tiff"), m.changed_bytes, ("[depth] FILE",)),
    "archive": Kind(("files.zip",), m.changed_bytes, ("[archive] FILE",)),
    "checksums": Kind(("tiny-1.lock",), m.of_text(m.changed_text), ("[checksums] FILE",)),
}
#: The class that is no file of the bench.
ARGUMENTS = "arguments"
NAMES = (*KINDS, ARGUMENTS)
# They also compile, once, what takes longer than any of the spoiled ones may.
_SOUND_LINES = {
    ARGUMENTS: (
        "list",
        "doctor",
        "check-method local",
        "run --method graph-cuts --dataset tiny.zarr --split Two --limit 1 --out out",
        "score --predictions maps --dataset tiny.zarr --method mine --out out",
        "audit split tiny.zarr --test-scenes 1",
        "rig optics pairs --lens lens.csv --range 1.5 2.2",
    )
}


def sound_inputs(name: str) -> range:
    """Return the numbers of the inputs of a class that are sound, and must succeed."""
    calls = KINDS[name].calls if name in KINDS else _SOUND_LINES.get(name, ("",))
    return range(1 - len(calls), 1)


def make(name: str, seed: int, number: int, bench: Bench) -> Given:
    """Return an input of a class by its number; from 1 on they are spoiled."""
    random = Random(f"{seed}/{name}/{number}")
    if name == ARGUMENTS:
        words = command_line(random) if number > 0 else _SOUND_LINES[name][-number].split()
        return Given(name, tuple(words))
    return KINDS[name].make(name, bench, random, None if number > 0 else -number)


def is_reader(call: tuple[str, ...]) -> bool:
    """Return whether an input calls a reader and not the command line."""
    return call[0].strip("[]") in READERS and call[0].startswith("[")


def read(call: tuple[str, ...], folder: Path) -> None:
    """Call an input's reader on its file."""
    READERS[call[0].strip("[]")](folder / call[1])
