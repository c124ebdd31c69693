"""The scripts that the documentation names run."""

import importlib
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray

import dfdbench
from dfdbench.methods.calling import check_answer

DOCS = Path(__file__).parents[1] / "docs"


def test_a_script_finds_what_it_imports_and_is_named() -> None:
    text = "".join(path.read_text("utf-8") for path in DOCS.glob("*.md"))
    for script in DOCS.glob("*.py"):
        assert callable(runpy.run_path(str(script))["main"])
        assert f"docs/{script.name}" in text


@pytest.mark.slow
def test_a_source_of_ones_own_is_built_as_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = (DOCS / "your_own_data.md").read_text("utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)
    exec(block, {})
    assert capsys.readouterr().out == "162 pairs\n"


def test_the_pages_table_of_tracks_is_that_of_the_board(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(DOCS.parent)
    main = runpy.run_path(str(DOCS / "tracks_rows.py"))["main"]
    # The middle of the page is made anew, whatever it says.
    page, made = (DOCS / "tracks.md").read_text("utf-8"), tmp_path / "tracks.md"
    emptied = re.sub(r"(<!-- written by docs/.*?\n).*?(<!-- end -->)", r"\1\2", page, flags=re.S)
    assert emptied != page
    made.write_text(emptied, "utf-8")
    monkeypatch.setitem(main.__globals__, "PAGE", made)
    for drawn in ("tracks_figure", "write_figure"):
        monkeypatch.setitem(main.__globals__, drawn, lambda *_: None)
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
    stack = xarray.DataArray(
        images,
        dims=("image", "y", "x", "channel"),
        coords={
            "role": ("image", ["infocus", "defocus", "defocus"]),
            "focus_distance": ("image", [np.nan, 2.0, 1.0]),
        },
    )
    found = check_answer(method(stack), (33, 50), "metres")
    assert found[0] is not None
    assert (found[0][:, 25:] == 2.0).all()
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
def test_a_camera_is_as_far_from_itself_as_is_said(tmp_path: Path) -> None:
    names = runpy.run_path(str(DOCS / "cameras.py"))["main"].__globals__
    said = names["matrices"](pd.read_csv(DOCS / "cameras.csv"))["s-transform"]
    stores = [names["built"](name, tmp_path) for name in ("plain", "inside")]
    found = dfdbench.run_transfer("s-transform", stores).table()
    assert found.to_numpy() == pytest.approx(said.loc[found.index, found.columns].to_numpy(), 1e-3)
