"""No command writes into a data set, a run, or one of its own inputs."""

import hashlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from dfdbench.datasets.dataset import Dataset
from tests.cli.command import Command
from tests.conftest import TINY_TOML
from tests.fuzz.arguments import verbs
from tests.made_folder import make_folder

#: The options that name a place to write to; `build --store` has a test of its own.
OUTPUTS = {"out", "png", "figure"}
LENS = "rig optics blur --f-number 2 --focal-length 9.6mm --focus 0.5m --pixel 4.8um"
SEARCH = "thesis search architecture --dataset STORE --split test --bounds crop=12:16"
# HELD is replaced by the store, then by a run.
COMMANDS = {
    ("new-dataset", "out"): "new-dataset photos --out HELD/x.toml",
    ("export", "png"): "export STORE --png HELD",
    ("run", "out"): "run --method constant --dataset STORE --out HELD/x",
    ("score", "out"): "score --predictions maps --dataset STORE --out HELD/x",
    ("tracks", "out"): "tracks --method constant --dataset demo --out HELD",
    ("transfer", "out"): "transfer --method local --dataset STORE --dataset STORE --out HELD",
    ("predict", "out"): "predict a.png b.png --method local --out HELD/x.npy",
    ("predict", "figure"): "predict a.png b.png --method local --out x.npy --figure HELD/x.png",
    ("export-onnx", "out"): "export-onnx u-net --param weights=demo --out HELD/x.onnx",
    ("train", "out"): "train dfd-net --dataset STORE --config quick --out HELD/x",
    ("thesis experiment", "out"): "thesis experiment repeatability --dataset STORE --out HELD",
    ("thesis search architecture", "out"): f"{SEARCH} --out HELD",
    ("thesis reduce", "out"): "thesis reduce --weights demo --dataset STORE --out HELD",
    ("report", "out"): "report run --out HELD",
    ("report", "figure"): "report run --format csv --figure HELD/x.png",
    ("compare", "out"): "compare run other --out HELD/x.png",
    ("audit depths", "figure"): "audit depths STORE --figure HELD/x.png",
    ("audit coverage", "out"): "audit coverage STORE --out HELD",
    ("audit split", "out"): "audit split STORE --test-scenes 1 --out HELD",
    ("audit difficulty", "out"): "audit difficulty STORE --out HELD",
    ("rig optics blur", "out"): f"{LENS} --out HELD/x.png",
    ("rig optics pairs", "out"): "rig optics pairs --out HELD/x.png",
    ("rig optics sharpness", "out"): "rig optics sharpness photos --out HELD",
    ("rig simulate realworld", "out"): "rig simulate realworld --out HELD",
    ("rig simulate lens", "out"): "rig simulate lens --out HELD",
}


@pytest.fixture
def work(dfdbench: Command, tiny_store: Dataset) -> Iterator[None]:
    run = f"run --method constant --dataset {tiny_store.path} --out run"
    dfdbench.fine(run, "--no-figures", "--no-predictions")
    shutil.copytree("run", "other")
    make_folder(Path("photos"))
    Path("maps").mkdir()
    before = content(Path("run")), content(Path(str(tiny_store.path)))
    yield
    assert (content(Path("run")), content(Path(str(tiny_store.path)))) == before


def content(folder: Path) -> dict[str, str]:
    return {
        str(path): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        for path in folder.rglob("*")
    }


def test_every_option_that_names_a_place_is_looked_at() -> None:
    found = set()
    for label, command in verbs().items():
        shown = [p.name for p in command.params if not getattr(p, "hidden", False)]
        found |= {(label, option) for option in OUTPUTS & {*shown}}
    assert found == set(COMMANDS)


@pytest.mark.slow
@pytest.mark.usefixtures("work")
def test_no_command_writes_into_a_data_set_or_a_run(dfdbench: Command, tiny_store: Dataset) -> None:
    store = str(tiny_store.path)
    for command in COMMANDS.values():
        for held in (store, "run"):
            words = command.replace("STORE", store).replace("HELD", held)
            dfdbench.refused("this command would write into", words)


@pytest.mark.usefixtures("work")
def test_no_verb_writes_where_it_reads(dfdbench: Command, tiny_store: Dataset) -> None:
    Path("tiny.toml").write_text(TINY_TOML)
    before = content(Path())
    for command in (
        "report run/result.json --format csv --out run/result.json",
        "score --predictions maps --dataset STORE --out maps",
        "run --method constant --dataset STORE --out STORE",
        "new-dataset photos --out photos/mine.toml",
        "build tiny.toml --source photos --store photos/mine.zarr",
        "build demo --store STORE/below.zarr",
        "build demo --cache run",
    ):
        words = command.replace("STORE", str(tiny_store.path))
        dfdbench.refused("this command would write into", words)
        assert content(Path()) == before, command
