import errno
import json
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from dfdbench.system.files import writing_folder
from tests.cli.command import Command
from tests.conftest import write_png
from tests.evaluation.test_predict import LENS


def photographs(folder: Path) -> tuple[str, str]:
    noise = np.random.default_rng(0).uniform(0, 255, (64, 80, 3))
    sharp = np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.5), np.uint8)
    write_png(folder / "infocus.png", sharp)
    write_png(folder / "defocus.png", np.asarray(cv2.GaussianBlur(sharp, (0, 0), 1), np.uint8))
    return str(folder / "infocus.png"), str(folder / "defocus.png")


def test_two_photographs_give_a_depth_map_and_a_picture(dfdbench: Command, tmp_path: Path) -> None:
    images = photographs(tmp_path)
    predict = ("predict", *images, "--method", "mymodule:predict", "--out", "depth.png")
    told = dfdbench.fine(*predict, "--figure", "picture.png")
    assert "depth.png: depth levels from 0 (far) to 255 (near)" in told.out
    assert "(the file holds levels times 256)" in told.out
    assert "odd " not in told.err
    depth = np.asarray(cv2.imread("depth.png", cv2.IMREAD_UNCHANGED))
    assert (depth.shape, str(depth.dtype), int(depth[0, 0])) == ((64, 80), "uint16", 90 * 256)
    assert np.asarray(cv2.imread("picture.png")).ndim == 3
    told = dfdbench.fine("predict", *images, "--method", "mymodule:near", "--out", "depth.npy")
    assert "odd          100 % of the pixels are at one end of the levels" in told.err
    told = dfdbench.fine("predict", *images[::-1], *predict[3:], "--no-align")
    assert "odd          the second photograph is the sharper one" in told.err
    assert "no such folder" in dfdbench.refused("nowhere", "predict", "nowhere", *predict[3:]).err
    for image in images:
        Path(image).write_bytes(b"")
    assert images[1] in dfdbench.refused(images[0], *predict).err


def test_two_predictions_do_not_write_into_one_folder(dfdbench: Command, tmp_path: Path) -> None:
    (tmp_path / "in/a").mkdir(parents=True)
    photographs(tmp_path / "in/a")
    words = ("predict", str(tmp_path / "in"), "--method", "mymodule:predict", "--no-align", "--out")
    with writing_folder(Path("out"), "prediction"):
        dfdbench.refused("another prediction is writing this folder", *words, "out")
    assert not Path("out").exists()
    dfdbench.fine(*words, "out")


def test_an_answer_that_cannot_be_printed_is_not_the_folder_s(
    dfdbench: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in/a").mkdir(parents=True)
    photographs(tmp_path / "in/a")
    broken = OSError(errno.EIO, "Input/output error")
    monkeypatch.setattr("dfdbench.cli.methods.show", Mock(side_effect=broken))
    words = ("predict", str(tmp_path / "in"), "--method", "mymodule:predict", "--no-align")
    refused = dfdbench.refused("error: Input/output error", *words, "--out=out")
    assert "cannot write" not in refused.err


def test_every_pair_is_tried_and_all_that_fails_named(dfdbench: Command, tmp_path: Path) -> None:
    folders = {name: tmp_path / "in" / name for name in ("a", "b", "cut", "dark_1", "lone", "text")}
    for folder in folders.values():
        folder.mkdir(parents=True)
        photographs(folder)
    for name in ("infocus.png", "defocus.png"):
        write_png(folders["dark_1"] / name, np.full((64, 80, 3), 20, np.uint8))
    whole = (folders["cut"] / "infocus.png").read_bytes()
    (folders["cut"] / "infocus.png").write_bytes(whole[: len(whole) // 2])
    (folders["lone"] / "defocus.png").unlink()
    (folders["text"] / "defocus.png").write_text("no image")
    words = ("predict", str(tmp_path / "in"), "--method", "mymodule:dim", "--no-align", "--out")
    told = dfdbench(*words, "out")
    assert (told.status, [path.name for path in Path("out").glob("*.np?")]) == (2, ["dark_1.npy"])
    assert "out: 1 map of" in told.out
    assert "error: 4 problems:" in told.err
    assert f"there is no defocus image beside it ({folders['lone'] / 'infocus.png'})" in told.err
    assert "no depth map: raised RuntimeError: too bright" in told.err
    assert " (a, b)\nFix: mend the method" in told.err
    for path in (folders["cut"] / "infocus.png", folders["text"] / "defocus.png"):
        assert f"({path})" in told.err
    assert "taken over   1 map from before" in dfdbench(*words, "out").err
    write_png(folders["dark_1"] / "infocus.png", np.full((64, 80, 3), 250, np.uint8))
    left = "left         of an earlier call, and not of this one: dark_1.npy"
    assert left in dfdbench(*words, "out").err
    moved = dfdbench(*words, "out", "--seed", "2").err
    assert "maps of an earlier, other call were moved to out.previous" in moved
    assert not list(Path("out").glob("*.np?"))
    far = "class Far:\n    unit = 'metres'\n    __call__ = staticmethod(dim)\n"
    Path("far.py").write_text("from mymodule import dim\n\n" + far)
    dfdbench.refused("4 problems", *words, "out.zip", "--method", "far:Far")
    assert not Path("out.zip").exists()


def test_a_stack_that_cannot_be_read_is_named_beside_the_others(
    dfdbench: Command, tmp_path: Path
) -> None:
    (tmp_path / "in").mkdir()
    photographs(tmp_path / "in")
    for name, attributes in (("far", {"unit": "metres"}), ("list", [])):
        write_png(tmp_path / "in" / name / "a.png", np.zeros((64, 80, 3), np.uint8))
        said = {"images": ["a.png", "a.png"], "coordinates": {}, "attributes": attributes}
        (tmp_path / "in" / name / "stack.json").write_text(json.dumps(said))
    words = ("predict", str(tmp_path / "in"), "--method", "mymodule:predict", "--no-align")
    told = dfdbench(*words, "--out", "out")
    assert told.status == 2
    assert "without ends of depth (far)" in told.err
    assert (
        f"the stack cannot be read: 'list' object has no attribute 'items' ({tmp_path}" in told.err
    )
    assert [path.name for path in Path("out").glob("*.np?")] == ["in.npy"]


def test_mistakes_are_refused_before_anything_is_written(dfdbench: Command, tmp_path: Path) -> None:
    images = photographs(tmp_path)
    (tmp_path / "empty").mkdir()
    Path("lens.toml").write_text(LENS)
    for words, says in (
        ((images[0], "--method", "local"), "two photographs or a folder of pairs are needed"),
        ((str(tmp_path / "empty"), "--method", "local"), "no pair and no stack in this folder"),
        ((*images, "--fitted", "run", "--lens", "lens.toml"), "leave out --lens, or --fitted"),
        ((*images, "--weights", "demo", "--param", "weights=robust"), "leave out --param weights"),
        ((images[0], "nothing.png", "--method", "mymodule:predict"), "nothing.png"),
        ((*images, "--method", "graph-cuts"), "--fitted RUN"),
        (images, "--method NAME"),
        ((images[0], images[0], "--method", "local"), "are one file"),
        ((*images, "--method", "mymodule:predict", "--figure", "q.xyz"), "not a picture's name"),
        ((*images, "--method", "mymodule:predict", "--out", "depth.gif"), ".npy, .npz or .png"),
        ((str(tmp_path), "--method", "mymodule:predict", "--out", "maps.png"), "into one file"),
        ((*images, "--method", "mymodule:predict", "--weights", "demo"), "takes no weights"),
        ((*images, "--method", "mymodule:predict", "--lens", "lens.toml"), "takes no lens"),
        ((*images, "--method", "s-transform", "--lens", "lens.toml"), "the focus is inside"),
    ):
        dfdbench.refused(says, "predict", "--out", "depth.npy", *words)
        assert not Path("depth.npy").exists()


def test_check_method_passes_and_fails(dfdbench: Command) -> None:
    # It prints, on each of the nine pairs.
    assert "fit for a run, 9 warnings" in dfdbench.fine("check-method mymodule:predict").out
    bad = dfdbench("check-method mymodule:nan")
    assert (bad.status, "NaN" in bad.out) == (1, True)


@pytest.mark.slow
def test_check_method_calibrates_a_method_that_is_not_told_the_blur(dfdbench: Command) -> None:
    good = dfdbench.fine("check-method local --param window=3")
    assert "fit for a run" in good.out
    assert "fit, on two made pairs" in good.out


def test_a_network_is_exported_and_runs_from_its_file(dfdbench: Command, tmp_path: Path) -> None:
    for needed in ("torch", "onnxruntime"):
        pytest.importorskip(needed, reason="needs the extras nets and onnx")
    export = "export-onnx dfd-net --param weights=demo --out net.onnx"
    told = dfdbench.facts(export)
    assert (told["model"], told["description"]) == ("net.onnx", "net.toml")
    images = photographs(tmp_path)
    dfdbench.fine("predict", *images, "--method", "net.onnx", "--no-align", "--out", "depth.npy")
    assert np.load("depth.npy").shape == (64, 80)
    dfdbench.refused("no such parameter", f"{export} --param tile=64 --param device=cpu")
    dfdbench.refused("is no network of pairs", "export-onnx volume-net --out net.onnx")
    Path("net.toml").unlink()
    dfdbench.refused("has no description", "check-method net.onnx")
