"""Our networks as ONNX files give the depth that they give here."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("onnxruntime", reason="needs the extra onnx")
pytest.importorskip("torch", reason="needs the extra nets")

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError
from dfdbench.methods.networks.onnx_export import export_onnx
from dfdbench.methods.registry import load_method


@pytest.fixture(scope="module")
def u_net(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("onnx") / "u-net.onnx"
    assert export_onnx("u-net", path, weights="demo") == path.with_suffix(".toml")
    return path


def test_an_exported_network_gives_the_networks_depth(u_net: Path, small_demo: Dataset) -> None:
    pair = small_demo.captures("test")[0]
    ours = load_method("u-net", {"weights": "demo", "device": "cpu"}, {})
    theirs = load_method(str(u_net), {}, {})
    assert (theirs.name, theirs.trained_on) == ("u-net.onnx", ours.trained_on)
    apart = np.abs(ours(pair.infocus, pair.defocus) - theirs(pair.infocus, pair.defocus))
    # Where two levels are equally likely but for rounding, either library may take the other.
    assert apart.mean() < 1e-3
    assert np.count_nonzero(apart > 1e-3) <= 1e-4 * apart.size


def test_the_median_level_is_exported_too(tmp_path: Path, small_demo: Dataset) -> None:
    corner = small_demo.captures("test").crop(0, (slice(0, 66), slice(0, 71)))
    export_onnx("dfd-net", tmp_path / "net.onnx", weights="robust", readout="median")
    given = {"weights": "robust", "device": "cpu", "readout": "median"}
    net, exported = load_method("dfd-net", given, {}), load_method(f"{tmp_path}/net.onnx", {}, {})
    # These weights started from others, which saw more.
    assert "demo-1" in str(exported.trained_on)
    assert exported.trained_on == net.trained_on
    ours, theirs = (each(corner.infocus, corner.defocus) for each in (net, exported))
    assert theirs.shape == (66, 71)
    assert np.abs(ours - theirs).mean() < 2e-3


def test_what_cannot_be_exported_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken.toml").write_text("of another use")
    refused: list[tuple[str, str, Any, str]] = [
        ("stack-net", "a.onnx", None, "is no network of pairs"),
        ("volume-net", "a.onnx", None, "is no network of pairs"),
        ("sgm", "a.onnx", None, "is no network of pairs"),
        ("u-net", "a.pt", None, "not the name of an ONNX file"),
        ("u-net", "a.onnx", "mean", "no such readout"),
        ("u-net", "taken.onnx", None, "a file of that name is there"),
    ]
    for method, name, readout, says in refused:
        with pytest.raises(InputError, match=says):
            export_onnx(method, tmp_path / name, "demo", readout)
        assert [path.read_text() for path in tmp_path.iterdir()] == ["of another use"]


def test_no_file_is_replaced(u_net: Path) -> None:
    u_net.with_suffix(".toml").write_text(edited := "# edited by hand")
    with pytest.raises(InputError, match=r"is there.*\n.*--out NAME\.onnx"):
        export_onnx("u-net", u_net, "demo")
    assert u_net.with_suffix(".toml").read_text() == edited


def test_without_the_package_onnx_the_error_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("dfdbench.methods.networks.onnx_export.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'dfdbench\[onnx\]'"):
        export_onnx("u-net", tmp_path / "n.onnx", weights="demo")
    assert not list(tmp_path.iterdir())
