import io
import shlex
import shutil
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset
from tests.cli.command import Command
from tests.conftest import TINY_TOML, store_of
from tests.made_folder import make_folder
from tests.made_stack_folder import make_stacks
from tests.made_zedd import MOTORS, floor, make_zedd
from tests.process import python
from tests.site import Site


def test_missing_pairs_fail_the_build_unless_allowed(
    dfdbench: Command, tiny_toml: str, tiny_folder: Path, tmp_path: Path
) -> None:
    for png in (tiny_folder / "One").rglob("*.png"):
        png.unlink()
    (tiny_folder / "Two/Illum1/Exp0/view5.png").unlink()
    # A depth map is that of both exposures.
    (tiny_folder / "Two/disp1.png").unlink()
    store = tmp_path / "s.zarr"
    build = f"build {tiny_toml} --source {tiny_folder} --store {store}"
    outcome = dfdbench.refused("missing: 7 of 11 pairs", build)
    assert "One" in outcome.err
    assert "view5/illumination1/exposure0" in outcome.err
    assert "https://example.org/tiny/One/Illum1/Exp0/view1.png" in outcome.err
    assert "2 of them kept from before" in dfdbench.fine(build, "--allow-missing").out
    assert len(Dataset(store).attributes["missing_pairs"]) == 7
    assert len(Dataset(store).pairs("all")) == 4


#: The command, which is sent a signal once the first scene is written, and writes no second before
#: that has come: how fast the machine is makes no difference.
STOPPED = """
import os, signal, sys, threading
from dfdbench.__main__ import main
from dfdbench.datasets.store_writer import SceneWriter

sent, stopped = getattr(signal, sys.argv.pop()), threading.Event()
write = SceneWriter.write

def handle(number, frame):
    stopped.set()
    raise KeyboardInterrupt

def write_and_stop(self, *given):
    digest = write(self, *given)
    if not stopped.is_set():
        os.kill(os.getpid(), sent)
        stopped.wait(60)
    return digest

signal.default_int_handler = handle
signal.signal(signal.SIGINT, handle)
SceneWriter.write = write_and_stop
main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("sent", ["SIGINT", "SIGTERM"])
def test_a_stopped_build_loses_nothing(
    tiny_toml: str, tiny_folder: Path, tmp_path: Path, sent: str
) -> None:
    whole = store_of(TINY_TOML, tiny_folder, tmp_path / "whole.zarr")
    store = tmp_path / "tiny.zarr"
    arguments = ["build", tiny_toml, "--store", str(store), "--source", str(tiny_folder)]
    stopped = python("-c", STOPPED, *arguments, "--workers", "1", sent)
    assert stopped.returncode == 130
    assert "goes on from here" in stopped.stderr
    assert "Traceback" not in stopped.stderr
    assert not store.exists()
    again = python("-m", "dfdbench", *arguments)
    assert again.returncode == 0
    assert whole.fingerprint in again.stdout
    assert "kept from before" in again.stdout


def test_from_the_site_to_files(dfdbench: Command, site: Site, tmp_path: Path) -> None:
    cache = ("--cache", str(tmp_path / "mine"))
    built = dfdbench.fine("build tiny-1.toml", *cache)
    assert "11 pairs of 3 scenes" in built.out
    assert "fetched 17 files" in built.err
    assert "tiny-1.lock" in built.err
    asked = len(site.requests)
    assert "3 of them kept from before" in dfdbench.fine("build tiny-1.toml --offline", *cache).out
    assert len(site.requests) == asked
    store = str(tmp_path / "mine/stores/tiny-1.zarr")
    assert "sound" in dfdbench.fine("verify", store).out
    shown = dfdbench("info", store)
    assert "11 of 11, 0 missing" in shown.out
    assert "published: sigma_min 0.32" in shown.out
    assert len(dfdbench("info", store, "--pairs", "One").out.splitlines()) == 4
    dfdbench.fine("export", store, "--png", "png")
    assert Path("png/One/Illum1/Exp0/view1_lin_0.32_2.88.png").exists()
    min((Path(store) / "One/depth").glob("c*")).write_bytes(b"rot")
    broken = dfdbench("verify", store)
    assert broken.status == 1
    assert "One/depth: cannot be decoded" in broken.out
    assert "3 scenes, 2 of them kept" in dfdbench("build tiny-1.toml --offline", *cache).out
    assert dfdbench("verify", store).status == 0


@pytest.mark.slow
def test_a_cluster_does_both(dfdbench: Command, site: Site, cluster: str, tmp_path: Path) -> None:
    store, other = str(tmp_path / "tiny.zarr"), str(tmp_path / "other.zarr")
    built = dfdbench.fine("build tiny-1.toml --store", store, "--scheduler", cluster)
    here = dfdbench("build tiny-1.toml --store", other, "--workers", "2")
    assert built.out.splitlines()[-1] == here.out.splitlines()[-1]
    run = f"run --method constant --dataset {store} --scheduler {cluster} --out out --tables"
    assert "several at once: not comparable" in " ".join(dfdbench.fine(run).out.split())


def test_the_next_command_can_be_pasted(dfdbench: Command, tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "own <fish>")
    told = dfdbench.facts("new-dataset", str(folder), "--out", "fish-1.toml")["next"]
    assert shlex.split(told)[-1] == str(folder)
    assert 'name = "fish"\n' in Path("fish-1.toml").read_text()


def test_broken_scenes_are_named_and_the_rest_is_built(dfdbench: Command, tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "mine")
    written = dfdbench.fine("new-dataset", str(folder))
    assert "found:\n  4 scenes" in written.out
    assert "say yourself:" in written.out
    dfdbench.refused("file of that name is there", "new-dataset", str(folder))
    (folder / "desk/blurred.png").unlink()
    metres = np.asarray(cv2.imread(str(folder / "door/depth.png"), cv2.IMREAD_UNCHANGED))
    cv2.imwrite(str(folder / "door/depth.png"), metres // 1000)
    shutil.copy(folder / "shelf/blurred.png", folder / "lamp/blurred.png")
    image = np.asarray(cv2.imread(str(folder / "shelf/sharp.png")))
    cv2.imwrite(str(folder / "shelf/sharp.png"), cv2.GaussianBlur(image, (0, 0), 4))
    built = dfdbench.refused("1. a file is missing", "build mine-1.toml --source", str(folder))
    assert "built mine-1: 1 pair of 1 scene" in built.out
    assert "another unit, or other bounds" in built.err
    assert "depth_unit = 1 (metres)" in built.err
    assert "3. no alignment of the pair's images was found" in built.err
    assert "shelf/sharp.png: the defocus image is the sharper one" in built.err
    assert "missing: 3 of 4 pairs" in built.err
    assert "no pair at all    desk, door, lamp" in built.err
    dfdbench.fine("build mine-1.toml --source", str(folder), "--allow-missing")
    assert "what the source found out" in dfdbench("info mine").out


def test_zedd_is_built_and_run_as_its_page_says(dfdbench: Command, tmp_path: Path) -> None:
    folder = make_zedd(tmp_path / "ZEDD", scenes=2)
    (folder / "val/val_0002/gt/depth.npy").unlink()
    # A scene that is not there is one line, and not one for each of its files.
    built = dfdbench.refused("47 files are missing", "build zedd --source", str(folder))
    assert "built zedd-1: 5 pairs of 1 scene" in built.out
    assert "1. a file is missing" in built.err
    for method in ("mymodule:peak", "mymodule:predict"):
        run = f"run --method {method} --dataset zedd --split val_0001 --no-figures"
        assert "protocol valid" in dfdbench.fine(run).out


def test_zedd_submission_holds_metres_of_each_test_scene(dfdbench: Command, tmp_path: Path) -> None:
    folder = make_zedd(tmp_path / "ZEDD", split="test")
    dfdbench("build", "zedd-test", "--source", str(folder), "--allow-missing")
    assert "2 pairs" in dfdbench("export", "zedd-test", "--png", "stacks", "--images-only").out
    made = dfdbench("predict", "stacks", "--method", "mymodule:peak", "--out", "zedd.zip")
    assert "2 maps of distances in metres" in made.out
    with zipfile.ZipFile("zedd.zip") as archive:
        assert archive.namelist() == ["zedd_output_0001.npy", "zedd_output_0002.npy"]
        depth = np.load(io.BytesIO(archive.read("zedd_output_0002.npy")))
    assert (depth.dtype, depth.shape) == (np.float32, floor().shape)
    assert set(np.unique(depth)) <= {np.float32(metres) for metres in MOTORS.values()}
    levels = "predict stacks --method mymodule:first --out levels.zip"
    dfdbench.refused("answers in levels", levels)
    shutil.copytree("stacks/test_0001/aperture28", "stacks/test_0001/aperture14")
    twice = "predict stacks --method mymodule:peak --out twice.zip"
    dfdbench.refused("would be zedd_output_0001.npy, too", twice)
    Path("stacks/test_0001/aperture14").rename("stacks/val_0001")
    assert "one capture of each scene and number" in dfdbench("predict", *twice.split()[1:]).err
    assert [path.name for path in Path().glob("*.zip")] == ["zedd.zip"]


def test_a_set_without_depth_cannot_be_run(dfdbench: Command, tmp_path: Path) -> None:
    folder = make_stacks(tmp_path / "mine")
    for depth in folder.rglob("depth.npy"):
        depth.unlink()
    dfdbench.fine("new-dataset", str(folder))
    dfdbench.fine("build mine-1.toml --source", str(folder))
    run = "run --method mymodule:predict --dataset mine"
    dfdbench.refused(
        "mine has no depth to score against", "score --predictions maps --dataset mine"
    )
    outcome = dfdbench.refused("mine has no depth to score against", run)
    commands = outcome.err.split("Fix: dfdbench ")[1].split(", then dfdbench ")
    dfdbench.fine(commands[0])
    assert commands[1].startswith("predict IMAGES --method NAME --out MAPS")
