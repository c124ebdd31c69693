"""Draw the pictures of the site: python docs/site/pictures.py [GROUP ...].

Groups are methods, datasets, measured and gallery; by default all. Each picture is a small JPEG in
docs/assets/pictures, which is committed: building the site draws nothing. The demo set is built if
it is not there. A picture that lacks its data set is named, and the old one stays.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from gallery import GALLERY
from numpy.typing import NDArray
from PIL import Image

import dfdbench
from dfdbench.board.cards import Card, load_cards
from dfdbench.datasets.captures import Capture
from dfdbench.errors import DfdbenchError
from dfdbench.figures.style import depth_scales
from dfdbench.simulation.unseen import Photographs, render_pair

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs/assets/pictures"
#: What every method is drawn on: a pair, and the same view as a focal stack.
SCENE, SHOWN, LIMIT = "Kitchen", "Kitchen/view1/illumination1/exposure2", 3
PAIRS, STACKS = "demo", "demo@stack-9"
#: What is shown of the demo set: its test scenes, in the third of their lights.
SCENES, _SHOWN = ("Kitchen", "Library", "Market"), 2
#: What is shown of the sets that are drawn from seeds.
ROOMS_SEED, ROOMS = 7, (9, 0, 11)
#: Sets whose depths and difficulty are measured, where they are built.
MEASURED = ("demo", "realworld-sim", "middlebury-default", "dfd-indoor")
_GREY = 190
#: As good as this many bytes allow.
_QUALITIES, _MOST = (85, 75, 60, 45, 30), 100_000


def drawn_on(card: Card) -> str:
    """Return the data set that a method is drawn on."""
    return PAIRS if "pair" in card.takes else STACKS


def draw_methods() -> Iterator[str]:
    """Draw what each method with a card gives, and its error; keep the scores by region."""
    for name in (PAIRS, STACKS):
        dfdbench.build(name)
    facts = {}
    for name, card in load_cards(ROOT / "leaderboard").items():
        with tempfile.TemporaryDirectory() as folder:
            run = dfdbench.run(
                card.entry,
                drawn_on(card),
                SCENE,
                parameters=card.parameters,
                limit=LIMIT,
                out=Path(folder) / "run",
            )
            capture, depth = run.images(SHOWN)
            (record,) = (pair for pair in run.result.pairs if pair.id == SHOWN)
        facts[name] = {
            "nrmse": record.score("valid", "nrmse"),
            **{region: value for region, value in record.regions.items() if value is not None},
        }
        yield from _draw_depth(capture, depth, name)
    pair = _pair_shown()
    views = {"infocus": pair.infocus, "defocus": pair.defocus, "truth": _truth(pair)}
    yield from (_keep(f"demo/{name}", image) for name, image in views.items())
    (PICTURES / "demo/scores.json").write_text(json.dumps(facts, indent=1) + "\n", "utf-8")


def draw_datasets() -> Iterator[str]:
    """Draw captures of each set that is made by us: two images and the depth, a row a scene."""
    demo, board = dfdbench.build(PAIRS), dfdbench.build("realworld-sim")
    yield _keep_captures("demo", [demo.read(demo.pairs(scene)[_SHOWN]) for scene in SCENES])
    yield _keep_captures("realworld-sim", [board.captures("test")[at] for at in range(3)])
    rooms = [render_pair(ROOMS_SEED, number) for number in ROOMS]
    yield _keep("datasets/unseen", np.vstack([_room(each) for each in rooms]))


def _keep_captures(name: str, captures: Sequence[Capture]) -> str:
    rows = [np.hstack([*each.shown[:2], _truth(each)]) for each in captures]
    return _keep(f"datasets/{name}", np.vstack(rows))


def _room(pair: Photographs) -> NDArray[np.uint8]:
    near, far = float(pair.depth.min()), float(pair.depth.max())
    scale = {"cmap": "viridis_r", "vmin": near, "vmax": far}
    depth = _coloured(pair.depth.astype(np.float64), scale)
    return np.hstack([*pair.images, depth])


def measure_datasets() -> Iterator[str]:
    """Keep what audits say of each set that is built here, and draw how often each depth occurs."""
    path = PICTURES / "datasets/measured.json"
    found = json.loads(path.read_text("utf-8")) if path.exists() else {}
    for name in MEASURED:
        try:
            store = dfdbench.open_dataset(name)
        except DfdbenchError as error:
            yield f"{name}: {error}"
            continue
        with tempfile.TemporaryDirectory() as folder:
            covered = _audit(folder, "coverage", name)
            facts = {"fingerprint": store.fingerprint, "uncovered": covered["shares"]["either"]}
            if store.recipe is not None:
                rows = _audit(folder, "difficulty", name)["rows"]
                for key in ("neighbours", "coarse"):
                    facts[key] = sum(row[key] for row in rows) / len(rows)
            _run(folder, ["dfdbench", "audit", "depths", name, "--figure", "depths.png"])
            with Image.open(Path(folder) / "depths.png") as drawn:
                yield _keep(f"datasets/{name}-depths", drawn)
        found[name] = facts
        path.write_text(json.dumps(found, indent=1) + "\n", "utf-8")


def draw_gallery() -> Iterator[str]:
    """Run the gallery's commands one after the other in a folder, and keep what they draw."""
    done: set[str] = set()
    with tempfile.TemporaryDirectory() as folder:
        for one in (each for figures in GALLERY.values() for each in figures):
            try:
                for line in (*one.before, one.command):
                    if line not in done:
                        _run(folder, shlex.split(line))
                        done.add(line)
                with Image.open(Path(folder) / one.file) as drawn:
                    yield _keep(f"gallery/{one.picture.stem}", drawn)
            except (OSError, SystemExit) as error:
                yield f"{one.function}: left as it is; {error}"
            if one.function == "show":
                _keep_photographs(Path(folder) / "pairs")


def _keep_photographs(place: Path) -> None:
    place.mkdir()
    pair = _pair_shown()
    for name, image in {"sharp": pair.infocus, "blurred": pair.defocus}.items():
        Image.fromarray(image).save(place / f"{name}.png")


def _audit(folder: str, what: str, name: str) -> dict[str, Any]:
    _run(folder, ["dfdbench", "audit", what, name, "--out", what])
    return dict(json.loads((Path(folder) / what / f"{what}.json").read_text("utf-8")))


def _run(folder: str, words: Sequence[str]) -> None:
    """Run a command in a folder; status 1 says that an audit found something."""
    # -P: what lies in the folder is not to be imported.
    python = [sys.executable, "-P"]
    command = [*python, *(["-m", *words] if words[0] == "dfdbench" else words[1:])]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{shlex.join(words)}: {done.returncode}\n{done.stderr[-800:]}")


def _pair_shown() -> Capture:
    store = dfdbench.build(PAIRS)
    return store.read(next(pair for pair in store.pairs(SCENE) if pair.id == SHOWN))


def _truth(capture: Capture) -> NDArray[np.uint8]:
    known = capture.depth.astype(np.float64)
    return _coloured(known, depth_scales(capture.about, known)[0])


def _draw_depth(capture: Capture, depth: NDArray[np.floating], name: str) -> Iterator[str]:
    known = capture.depth.astype(np.float64)
    scale, errors = depth_scales(capture.about, known)
    yield _keep(f"demo/{name}", _coloured(depth.astype(np.float64), scale))
    yield _keep(f"demo/{name}-error", _coloured(depth - known, errors))


def _coloured(values: NDArray[np.float64], scale: dict[str, object]) -> NDArray[np.uint8]:
    """Return a map as matplotlib colours it, grey where it is NaN."""
    low, high = float(scale["vmin"]), float(scale["vmax"])  # type: ignore[arg-type]
    shares = np.clip((values - low) / (high - low), 0, 1)
    colours = mpl.colormaps[str(scale["cmap"])](np.nan_to_num(shares))[..., :3] * 255
    return np.where(np.isnan(values)[..., None], _GREY, colours).astype(np.uint8)


def _keep(name: str, image: NDArray[np.uint8] | Image.Image, widest: int = 960) -> str:
    picture = image if isinstance(image, Image.Image) else Image.fromarray(image)
    path = PICTURES / f"{name}.jpg"
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = picture.convert("RGB")
    picture.thumbnail((widest, 10 * widest), Image.Resampling.LANCZOS)
    for quality in _QUALITIES:
        picture.save(path, quality=quality, optimize=True)
        if path.stat().st_size <= _MOST:
            break
    return f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB"


GROUPS = {
    "methods": draw_methods,
    "datasets": draw_datasets,
    "measured": measure_datasets,
    "gallery": draw_gallery,
}


def main(*groups: str) -> None:
    """Draw the groups of pictures that are named, by default all."""
    for group in groups or GROUPS:
        for said in GROUPS[group]():
            print(said, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
