"""From a folder to a table, as docs/your_own_data.md has it."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli.command import Command
from tests.made_folder import make_folder
from tests.made_stacks import make_stacks
from tests.made_zedd import make_zedd


@pytest.mark.slow
def test_from_a_folder_to_a_table(dfdbench: Command, tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "mine")
    written = dfdbench("new-dataset", str(folder))
    assert written.status == 0
    assert "found:\n  4 scenes" in written.out
    assert "say yourself:" in written.out
    assert "file of that name is there" in dfdbench("new-dataset", str(folder)).err
    built = dfdbench("build", "mine-1.toml", "--source", str(folder))
    assert built.status == 0
    assert "built mine-1: 4 pairs of 4 scenes" in built.out
    assert "what lays one image on the other" in dfdbench("info", store_of(built.out)).out
    ran = dfdbench("run", "--method", "mymodule:predict", "--dataset", "mine-1.toml")
    assert ran.status == 0
    assert "protocol valid" in ran.out
    assert "train (own): 3 pairs" in dfdbench("info", "mine-1.toml").out
    assert dfdbench("export", "mine-1.toml", "--png", "png").status == 0
    assert Path("png/desk/capture1_defocus.png").is_file()
    defocus = cv2.imread("png/desk/capture1_defocus.png")
    assert defocus is not None
    for name in dfdbench("info", "mine-1.toml", "--pairs", "test").out.split():
        Path("elsewhere", name).parent.mkdir(parents=True, exist_ok=True)
        np.save(f"elsewhere/{name}.npy", np.full(defocus.shape[:2], 100, np.uint8))
    scored = dfdbench("score", "--predictions", "elsewhere", "--dataset", "mine-1.toml")
    assert scored.status == 0
    assert "protocol valid" in scored.out
    assert dfdbench("audit", "coverage", "mine-1.toml").status in (0, 1)
    results = "results/mine-1-test/mymodule-predict"
    report = dfdbench("report", results, "--out", "page", "--format", "markdown")
    assert report.status == 0
    assert "valid" in Path("page/report.md").read_text("utf-8")


def store_of(told: str) -> str:
    return next(line.split()[1] for line in told.splitlines() if line.startswith("store"))


def test_broken_scenes_are_named_and_the_rest_is_built(dfdbench: Command, tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "mine")
    assert dfdbench("new-dataset", str(folder)).status == 0
    (folder / "desk/blurred.png").unlink()
    metres = cv2.imread(str(folder / "door/depth.png"), cv2.IMREAD_UNCHANGED)
    assert metres is not None
    cv2.imwrite(str(folder / "door/depth.png"), metres // 1000)
    image = cv2.imread(str(folder / "lamp/sharp.png"))
    assert image is not None
    cv2.imwrite(str(folder / "lamp/sharp.png"), cv2.GaussianBlur(image, (0, 0), 4))
    built = dfdbench("build", "mine-1.toml", "--source", str(folder))
    assert built.status == 2
    assert "built mine-1: 2 pairs of 2 scenes" in built.out
    assert "1. a file is missing" in built.err
    assert "2. depth in another unit" in built.err
    assert "depth_unit = 1 (metres)" in built.err
    assert "lamp/sharp.png: the defocus image is the sharper one" in built.err
    assert "missing: 2 of 4 pairs" in built.err
    assert "no pair at all    desk, door" in built.err
    again = dfdbench("build", "mine-1.toml", "--source", str(folder), "--allow-missing")
    assert again.status == 0


def test_an_unbuilt_set_says_how_to_build_it(dfdbench: Command, tmp_path: Path) -> None:
    folder = make_folder(tmp_path / "mine")
    assert dfdbench("new-dataset", str(folder)).status == 0
    outcome = dfdbench("run", "--method", "constant", "--dataset", "mine-1.toml")
    assert outcome.status == 2
    assert "dfdbench build mine-1.toml --source DIR" in outcome.err
    assert "name the folder: --source DIR" in dfdbench("build", "mine-1.toml").err


def test_zedd_is_built_and_run_as_its_page_says(dfdbench: Command, tmp_path: Path) -> None:
    folder = make_zedd(tmp_path / "ZEDD", scenes=2)
    (folder / "val/val_0002/gt/depth.npy").unlink()
    built = dfdbench("build", "zedd", "--source", str(folder))
    assert built.status == 2
    assert "built zedd-1: 5 pairs of 1 scene" in built.out
    # A scene that is not there is one line, and not one for each of its files.
    assert "47 files are missing" in built.err
    assert "1. a file is missing" in built.err
    Path("stacks.py").write_text(PEAK)
    for method in ("stacks:predict", "mymodule:predict"):
        ran = dfdbench("run", "--method", method, "--dataset", "zedd", "--split", "val_0001")
        assert ran.status == 0, ran.err
        assert "protocol valid" in ran.out


PEAK = """
import cv2
import numpy as np

def predict(stack):
    sharpness = [cv2.Laplacian(image, cv2.CV_32F).max(2) for image in stack.values[1:]]
    return stack.focus_distance.values[1:][np.argmax(sharpness, 0)].astype(np.float32)

predict.unit = "metres"
"""


def test_a_set_without_depth_cannot_be_run(dfdbench: Command, tmp_path: Path) -> None:
    folder = make_stacks(tmp_path / "mine")
    for depth in folder.rglob("depth.npy"):
        depth.unlink()
    assert dfdbench("new-dataset", str(folder)).status == 0
    assert dfdbench("build", "mine-1.toml", "--source", str(folder)).status == 0
    outcome = dfdbench("run", "--method", "mymodule:predict", "--dataset", "mine")
    assert outcome.status == 2
    assert "mine has no depth to score against" in outcome.err
    assert "predict" in outcome.err
