import json
import sys
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from dfdbench.cli import Verb
from tests.cli.command import Command
from tests.cli.test_rig import BLUR
from tests.conftest import TINY_TOML, write_png
from tests.fuzz.arguments import of_type, verbs
from tests.made_folder import make_folder
from tests.process import python, shell


def test_a_mistake_ends_with_a_message_and_status_2(dfdbench: Command) -> None:
    Path("tiny-1.toml").write_text(TINY_TOML)
    for words, told in (
        ("bild demo", "No such command 'bild'. Did you mean build?"),
        ("info midlebury", "did you mean middlebury"),
        ("info middlebury --pairs tst", "did you mean test"),
        ("info ./", "not a data set built by dfdbench"),
        ("build realworld@camera-1", "has no tracks"),
        ("build demo@law-1 --recipe text", "leave out --recipe"),
        ("build middlebury --offline", "--source DIR"),
        ("build realworld", "dfdbench build realworld --source DIR"),
        ("build demo --offline", "--offline cannot be given with demo"),
        ("build demo --store nosuch://x/y.zarr", "cannot reach places"),
        ("build demo --scheduler nonsense://x", "not a scheduler's address"),
        ("build tiny-1.toml --cache tiny-1.toml", "cannot keep the download"),
        ("run --method constant --dataset demo@law-1", "dfdbench build demo@law-1"),
        ("run --method mymodule:predict", "dfdbench build demo"),
        ("run --method local --protocol thesys", "did you mean thesis"),
        ("verify nothing.zarr", "no such store"),
        ("cache --cache tiny-1.toml", "no folder"),
        *((f"{verb} {'x' * 300}.toml", "too long") for verb in ("list --cache", "info", "report")),
    ):
        assert dfdbench.refused(told, words).err.startswith(("error: ", "Usage: "))


def test_every_verb_prints_json() -> None:
    groups = {"audit", "rig", "rig optics", "rig simulate", "thesis", "thesis search"}
    without = set(verbs())
    for name, verb in verbs().items():
        for option in verb.params:
            if option.name == "format" and "json" in of_type(option.type_descriptor.annotation):
                without.discard(name)
    assert without == groups


PREDICT = "predict a.png b.png --method mymodule:predict --no-align"


def test_with_json_standard_output_holds_one_document(dfdbench: Command, tmp_path: Path) -> None:
    make_folder(tmp_path / "mine")
    for name in ("a", "b"):
        write_png(Path(f"{name}.png"), np.full((40, 60, 3), 90, np.uint8))
    for words, status, name, told in (
        ("list", 0, "tables", ...),
        ("info middlebury --pairs Art", 0, "pairs", ...),
        ("info middlebury", 0, "manifest", ...),
        ("cache", 0, "folder", ...),
        ("cache clear downloads", 0, "removed", []),
        (f"new-dataset {tmp_path / 'mine'}", 0, "manifest", "mine-1.toml"),
        (f"build mine-1.toml --source {tmp_path / 'mine'} --store s.zarr", 0, "pairs", 4),
        ("info s.zarr", 0, "store", ...),
        ("verify s.zarr", 0, "sound", True),
        ("export s.zarr --png png", 0, "pairs", 4),
        (f"{PREDICT} --out d.npy", 0, "depth", "d.npy"),
        ("check-method mymodule:nan", 1, "failed", 10),
        ("run --method mymodule:nan --dataset s.zarr --out nan --no-figures", 1, "failed", 1),
        ("run --method constant --dataset s.zarr --out run --no-figures", 0, "folder", "run"),
        ("report run", 0, "tables", ...),
        ("report run --out t.json", 0, "file", "t.json"),
        (f"{BLUR} --pixel 4.8um", 0, "figure", "blur.png"),
        ("rig optics pairs", 0, "figure", "pairs.png"),
    ):
        done = dfdbench(f"{words} --format json")
        assert done.status == status, done.err
        found = json.loads(done.out)[name]
        assert told is ... or found == told, (words, found)
    assert json.loads(Path("t.json").read_text())["tables"][0]["rows"][0]["method"] == "constant"
    assert dfdbench.refused("did you mean middlebury", "info midlebury --format json").out == ""


def test_a_closed_pipe_is_no_mistake() -> None:
    outcome = shell(f"{sys.executable} -m dfdbench info middlebury --pairs all | head -1")
    assert (outcome.stdout, outcome.stderr) == ("Art/view1/illumination1/exposure0\n", "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_told() -> None:
    outcome = shell(f"{sys.executable} -m dfdbench list > /dev/full")
    assert outcome.returncode == 2
    assert outcome.stderr.startswith("error: No space left on device")
    assert "Traceback" not in outcome.stderr


#: What is imported by nothing that only looks: the command line starts quickly.
HEAVY = ("scipy", "numba", "matplotlib", "xarray", "zarr", "dask", "torch", "skimage", "pandas")

#: One after the other: what one of them imported is there for all that follow.
LINES = (
    ("--version", "numpy pydantic rich"),
    ("--help", "numpy pydantic rich"),
    ("audit --help", "numpy pydantic rich"),
    ("list", "numpy"),
    ("info demo", "numpy"),
    ("info demo --pairs test", "numpy"),
    ("build --help", ""),
    ("run --help", ""),
)
PROGRAM = f"""
import sys
from dfdbench.cli import main
for line, too in {LINES!r}:
    sys.argv = ["dfdbench", *line.split()]
    try:
        main()
    except SystemExit as end:
        assert not end.code, end.code
    heavy = [name for name in [*{HEAVY!r}, *too.split()] if name in sys.modules]
    assert not heavy, (line, heavy)
"""


def test_what_only_looks_imports_nothing_heavy() -> None:
    done = python("-c", PROGRAM)
    assert done.returncode == 0, done.stderr


def test_ctrl_c_in_a_verb_is_told(dfdbench: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    goes_on = "stopped; the same command goes on from here\n"
    monkeypatch.setattr("dfdbench.cli.thesis.open_dataset", Mock(side_effect=KeyboardInterrupt))
    assert dfdbench("thesis search architecture")[::2] == (130, goes_on)
    monkeypatch.setattr(Verb, "load", Mock(side_effect=KeyboardInterrupt))
    stopped = [dfdbench(verb)[::2] for verb in ("run", "report")]
    assert stopped == [(130, goes_on), (130, "stopped\n")]
