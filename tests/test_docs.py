"""The scripts that the documentation names run."""

import importlib
import re
import runpy
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray

import dfdbench
from dfdbench.datasets.dataset import Dataset
from dfdbench.methods.calling import check_answer
from dfdbench.metrics.protocol import RELEASED

DOCS = Path(__file__).parents[1] / "docs"
SCRIPTS = sorted(path.name for path in DOCS.glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_script_finds_what_it_imports_and_is_named(script: str) -> None:
    assert callable(runpy.run_path(str(DOCS / script))["main"])
    text = "".join(path.read_text("utf-8") for path in DOCS.glob("*.md"))
    assert f"docs/{script}" in text


def test_the_page_of_protocols_names_each_label() -> None:
    text = (DOCS / "protocols.md").read_text("utf-8")
    assert not [label for label in RELEASED if f"`{label}`" not in text]


@pytest.mark.slow
def test_a_source_of_ones_own_is_built_as_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "your_own_data.md").read_text("utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)
    exec(block, {})
    assert capsys.readouterr().out == "162 pairs\n"


@pytest.mark.slow
def test_the_pages_table_of_tracks_is_that_of_the_board(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(DOCS.parent)
    main = runpy.run_path(str(DOCS / "tracks_rows.py"))["main"]
    # The middle of the page is made anew, whatever it says.
    page = (DOCS / "tracks.md").read_text("utf-8")
    before, mark, rest = page.partition("<!-- written by docs/")
    first, _, after = rest.partition("<!-- end -->")
    made = tmp_path / "tracks.md"
    made.write_text(f"{before}{mark}{first.splitlines()[0]}\n<!-- end -->{after}", "utf-8")
    monkeypatch.setitem(main.__globals__, "PAGE", made)
    monkeypatch.setitem(main.__globals__, "PICTURE", tmp_path / "tracks_methods.png")
    main("demo-1-test")
    assert made.read_text("utf-8") == page


def test_the_adapter_for_a_published_stack_network_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch = pytest.importorskip("torch")
    text = (DOCS / "methods.md").read_text("utf-8")
    adapter = r"^```python\n(import numpy as np\nimport torch\n.*?)^```"
    (block,) = re.findall(adapter, text, re.S | re.M)
    assert len(block.splitlines()) <= 40
    # A stand-in for what authors publish: the distance at which a pixel is brightest.
    (tmp_path / "their_code.py").write_text(
        "import torch\n\n\nclass Network(torch.nn.Module):\n"
        "    def forward(self, images, focus):\n"
        "        assert images.shape[-2] % 32 == images.shape[-1] % 32 == 0\n"
        "        place = images.mean(2).argmax(1)\n"
        "        return focus[0][place]\n\n\n"
        "def load_network(weights):\n    assert weights == 'theirs.pt'\n    return Network()\n"
    )
    (tmp_path / "adapter.py").write_text(block)
    monkeypatch.syspath_prepend(tmp_path)
    method = importlib.import_module("adapter").StackNetwork("theirs.pt")
    images = np.zeros((3, 33, 50, 3), np.uint8)
    images[1:, :, 25:] = [[[[9]]], [[[5]]]]
    roles, distances = ["infocus", "defocus", "defocus"], [np.nan, 2.0, 1.0]
    coordinates = {"role": ("image", roles), "focus_distance": ("image", distances)}
    stack = xarray.DataArray(images, coordinates, ("image", "y", "x", "channel"))
    depth, _ = check_answer(method(stack), (33, 50), "metres")
    assert (depth[:, 25:] == 2.0).all()
    assert torch.is_grad_enabled()


@pytest.mark.slow
def test_the_tracks_are_as_far_from_rays_as_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = runpy.run_path(str(DOCS / "tracks_by_rays.py"))
    monkeypatch.setattr(sys, "argv", ["tracks_by_rays.py"])
    module["main"]()
    assert capsys.readouterr().out in (DOCS / "tracks.md").read_text()


@pytest.mark.slow
def test_cameras_are_compared_on_the_same_rooms(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    names = runpy.run_path(str(DOCS / "cameras.py"))["main"].__globals__
    smaller = {
        name: replace(
            camera, lens=replace(camera.lens, pixel_size=5 * camera.lens.pixel_size), shape=(48, 64)
        )
        for name, camera in names["CAMERAS"].items()
        if name in ("plain", "old-lens")
    }
    monkeypatch.setattr("dfdbench.simulation.rooms.lit", lambda scene, *_: scene)
    for name, value in {
        "render_pair": partial(names["render_pair"], rays=8),
        "CAMERAS": smaller,
        "METHODS": ("s-transform",),
        "ROOMS": 1,
        "TABLE": tmp_path / "cameras.csv",
    }.items():
        monkeypatch.setitem(names, name, value)
    names["main"](str(tmp_path))
    said = capsys.readouterr()
    assert said.err.splitlines()[-4:] == [
        "plain -> plain", "plain -> old-lens", "old-lens -> old-lens", "old-lens -> plain",
    ]  # fmt: skip
    assert (tmp_path / "cameras.png").stat().st_size > 10_000
    head, _, row, floor, *matrix = said.out.splitlines()
    assert head.startswith("| method |")
    assert row.startswith("| `s-transform` | 0.")
    assert floor.startswith("| `constant` | 0.")
    assert len(matrix) == 2 + 4
    depths = [Dataset(tmp_path / f"{name}.zarr").to_xarray("test-1").depth for name in smaller]
    # The same room; one of the two lenses breathes.
    assert 0 < np.abs(depths[0].values - depths[1].values).mean() < 0.2


@pytest.mark.slow
def test_a_camera_is_as_far_from_itself_as_is_said(tmp_path: Path) -> None:
    names = runpy.run_path(str(DOCS / "cameras.py"))["main"].__globals__
    said = names["matrices"](pd.read_csv(DOCS / "cameras.csv"))["s-transform"]
    stores = [names["built"](name, tmp_path) for name in ("plain", "inside")]
    found = dfdbench.run_transfer("s-transform", stores).table()
    assert found.to_numpy() == pytest.approx(said.loc[found.index, found.columns].to_numpy(), 1e-3)
