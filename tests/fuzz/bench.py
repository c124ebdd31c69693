"""What is spoiled: small sound files of every kind, each made when it is first asked for."""

import shutil
import zipfile
from collections.abc import Callable, Iterable
from functools import partial
from importlib import resources
from pathlib import Path

import cv2
import numpy as np

from dfdbench.datasets.dataset import Dataset
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.rig.lidar import write_ranges
from dfdbench.rig.registration import write_registration
from tests.board.made_boards import add, make_tracks, submit
from tests.conftest import TINY_TOML, make_tiny_set
from tests.evaluation.made_predictions import write_all
from tests.made_folder import FOLDER_TOML, make_folder, photograph

QUICK = """narrow = 64
crop = 16
crops_per_step = 1
steps = 2
expansion = "one"
evaluate_every = 2
evaluate_pairs = 1
"""
_METHODS = """
import numpy as np

def predict(infocus, defocus):
    return np.full(infocus.shape[:2], 90)

def nan(infocus, defocus):
    return np.full(infocus.shape[:2], np.nan)

def raises(infocus, defocus):
    raise ValueError("no depth")

class Fitted:
    def __init__(self):
        self.level = 0.0

    def fit(self, pairs):
        level = float(np.mean([pair.levels.mean() for pair in pairs]))
        return {"level": level, "curve": np.ones(3)}

    def restore(self, learned):
        self.level = learned["level"]

    def __call__(self, infocus, defocus):
        return np.full(infocus.shape[:2], self.level)
"""
_REPOSITORY = Path(__file__).parents[2]
#: A search that ends at once, asked for again to be gone on with.
SEARCH = (
    "thesis search architecture --dataset tiny.zarr --split test --particles 1 --iterations 0 "
    "--device cpu --threads 1 --score-pairs 1 --config quick.toml --bounds crop=12:16 "
    "--bounds kernel=1:3 --bounds width=8:128 --out search"
)
TRAIN = (
    "train dfd-net --dataset tiny.zarr --config quick.toml --device cpu --threads 1 --out training"
)


class Bench:
    """A folder of sound files; those that are spoiled are copies.

    Parameters
    ----------
    place : Path
        Where they are made.
    call : callable
        Calls the command line in a folder with some arguments, as tests do.
    """

    def __init__(self, place: Path, call: Callable[[Path, list[str]], object]) -> None:
        self.place = place
        self._call = call
        place.mkdir(parents=True, exist_ok=True)

    def item(self, name: str) -> Path:
        """Return a file or a folder by its name; it is not to be changed."""
        path = self.place / name
        if not path.exists():
            _MAKERS[name](self, path)
        return path

    def copy(self, name: str, folder: Path) -> None:
        """Put a copy into a folder, unless it is there."""
        source, target = self.item(name), folder / name
        if source.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=True)
        elif not target.exists():
            shutil.copyfile(source, target)

    def laid_out(self, folder: Path, items: Iterable[str]) -> Path:
        """Make a folder with copies, and return it."""
        folder.mkdir()
        for item in items:
            self.copy(item, folder)
        return folder

    def call(self, arguments: list[str]) -> None:
        """Make something by a command, in the folder of sound files."""
        self._call(self.place, arguments)


def _write(content: str, bench: Bench, path: Path) -> None:
    path.write_text(content, "utf-8")


def _tiny(bench: Bench, path: Path) -> None:
    make_tiny_set(bench.place)


def _run(method: str, bench: Bench, path: Path) -> None:
    store = Dataset(bench.item("tiny.zarr"))
    named = method.replace("mine.py", str(bench.item("mine.py")))
    run_method(store, load_for(store, named, {}), "test", path)


def _maps(bench: Bench, path: Path) -> None:
    store = Dataset(bench.item("tiny.zarr"))
    write_all(store, "test", path, lambda stem, depth: np.save(f"{stem}.npy", depth))
    first, *_ = sorted(path.rglob("*.npy"))
    depth = np.load(first)
    first.unlink()
    np.savez(first.with_suffix(".npz"), depth=depth)
    second, third, *_ = sorted(path.rglob("*.npy"))
    for file, suffix, values in (
        (second, ".png", (np.load(second) * 256).astype(np.uint16)),
        (third, ".tiff", np.load(third)),
    ):
        cv2.imwrite(str(file.with_suffix(suffix)), values)
        file.unlink()


def _board(bench: Bench, path: Path) -> None:
    shutil.copytree(_REPOSITORY / "leaderboard/published", path / "published")
    for name, score in (("mine", 0.1), ("other", 0.2)):
        add(path, name, score)
    submit(list(make_tracks("tracked", 0.2, ["noise-1", "camera-2"]).values()), path)
    (path / "fingerprints.json").write_text('{"tiny-1": ["' + "2" * 64 + '"]}')


def _weights(bench: Bench, path: Path) -> None:
    from tests.methods.made_weights import save_small

    save_small(path)


def _make_by(command: str, bench: Bench, path: Path) -> None:
    bench.item("tiny.zarr")
    bench.item("quick.toml")
    bench.call(command.split())


def _copy_shipped(name: str, bench: Bench, path: Path) -> None:
    path.write_bytes((resources.files("dfdbench.manifests") / name).read_bytes())


def _image(bench: Bench, path: Path) -> None:
    shown = photograph(1, (20, 24))
    image = shown.astype(np.uint16) * 257 if path.stem == "deep" else shown
    assert cv2.imwrite(str(path), image[..., 0] if path.stem == "depth" else image)


def _ranges(bench: Bench, path: Path) -> None:
    ranges = np.arange(64 * 16, dtype=np.int32).reshape(64, 16) + 1000
    np.save(path, ranges) if path.suffix == ".npy" else write_ranges(path, ranges)


def _registration(bench: Bench, path: Path) -> None:
    corners = np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]])
    write_registration(path, np.diag([2.0, 2.0, 1.0]), corners, "by the tests")


def _archive(bench: Bench, path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("One/disp1.png", "One/view1.png", "One/Illum1/Exp0/view1.png"):
            archive.writestr(name, b"some bytes" * 9)


_MAKERS: dict[str, Callable[[Bench, Path], object]] = {
    "tiny-1.toml": partial(_write, TINY_TOML),
    "demo-1.toml": partial(_copy_shipped, "demo-1.toml"),
    "realworld-1.toml": partial(_copy_shipped, "realworld-1.toml"),
    "mine-1.toml": partial(_write, FOLDER_TOML),
    "mine": lambda _, path: make_folder(path),
    "files.zip": _archive,
    "mine.py": partial(_write, _METHODS),
    "site": _tiny,
    "tiny.zarr": _tiny,
    "run": partial(_run, "constant"),
    "other": partial(_run, "mine.py:predict"),
    "fitted": partial(_run, "mine.py:Fitted"),
    "maps": _maps,
    "board": _board,
    "quick.toml": partial(_write, QUICK),
    "weights.safetensors": _weights,
    "training": partial(_make_by, TRAIN),
    "search": partial(_make_by, SEARCH),
    "lens.csv": partial(_copy_shipped, "realworld-1/lens_blur_radius_px.csv"),
    "beams.csv": partial(_copy_shipped, "realworld-1/os1_beams.csv"),
    "told.toml": partial(
        _write, "sigma_min = 0.2\nsigma_step = 0.006\nlevels = 256\nkernel_size = 11\n"
    ),
    "law.toml": partial(
        _write,
        f"sigmas = {[0.3 + 0.01 * level for level in range(256)]}\nkernel_size = 21\n"
        "exponent = 2.0\nnoise = [1.0]\n",
    ),
    **dict.fromkeys(
        ("sharp.png", "deep.png", "sharp.jpg", "sharp.tiff", "depth.png", "depth.jpg"), _image
    ),
    "depth.tiff": _image,
    "ranges.bin": _ranges,
    "ranges.npy": _ranges,
    "registration.toml": _registration,
    "tiny-1.lock": partial(_write, "0" * 64 + "  One/disp1.png\n" + "1" * 64 + "  Two/disp1.png\n"),
}
#: Everything that there is by name.
ITEMS = tuple(_MAKERS)
