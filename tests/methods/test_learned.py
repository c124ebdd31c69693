from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import safetensors.torch
import torch

from dfdbench.datasets.store import Store
from dfdbench.errors import MethodError
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.run import run_method
from dfdbench.methods.networks.weights import (
    Card,
    build_network,
    find_weights,
    load_weights,
    save_weights,
    shipped_weights,
)
from dfdbench.methods.registry import load
from tests.methods.networks.test_architectures import SMALL


def card(**changes: Any) -> Card:
    content = {
        "method": "dfd-net",
        "architecture": {"filters": list(SMALL)},
        "parameters": 100,
        "trained_on": "tiny-1, split train",
        "dataset": "tiny-1",
        "fingerprint": "0" * 64,
        "recipe": "published",
        "configuration": {"crop": 16},
        "seed": 3,
        "steps": 7,
        "seconds": 1.5,
        "ended_by": "its number of steps",
        "scored_on": "test, 2 pairs",
        "scores": {"nrmse": 0.25},
        "environment": {"torch": "2"},
    }
    return Card.model_validate(content | changes)


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    torch.manual_seed(2)
    path = tmp_path / "mine.safetensors"
    save_weights(path, build_network("dfd-net", {"filters": list(SMALL)}), card())
    return path


def test_weights_come_back_with_their_card(weights: Path) -> None:
    network, found = load_weights(weights, "dfd-net")
    assert found == card()
    assert not network.training
    torch.manual_seed(2)
    fresh = build_network("dfd-net", {"filters": list(SMALL)}).state_dict()
    assert all(torch.equal(fresh[name], value) for name, value in network.state_dict().items())
    page = weights.with_suffix(".md").read_text()
    assert "| trained on | tiny-1, split train |" in page
    assert "NRMSE 0.2500" in page


def test_the_same_weights_are_the_same_bytes(weights: Path, tmp_path: Path) -> None:
    network, found = load_weights(weights, "dfd-net")
    save_weights(tmp_path / "again.safetensors", network, found)
    assert (tmp_path / "again.safetensors").read_bytes() == weights.read_bytes()


def test_weights_that_cannot_be_used_say_why(weights: Path, tmp_path: Path) -> None:
    content = weights.read_bytes()
    for cut in (0, 5, len(content) // 2, len(content) - 1):
        (tmp_path / "cut.safetensors").write_bytes(content[:cut])
        with pytest.raises(MethodError, match="the weights cannot be read"):
            load_weights(tmp_path / "cut.safetensors", "dfd-net")
    with pytest.raises(MethodError, match="another architecture") as caught:
        load_weights(weights, "u-net")
    assert caught.value.problems[0].fix == "use them with dfd-net"
    foreign = tmp_path / "foreign.safetensors"
    safetensors.torch.save_file({"a": torch.zeros(2)}, foreign)
    with pytest.raises(MethodError, match="no model card"):
        load_weights(foreign, "dfd-net")
    safetensors.torch.save_file({"a": torch.zeros(2)}, foreign, {"dfdbench-card": '{"seed": "x"}'})
    with pytest.raises(MethodError, match="the model card cannot be read") as caught:
        load_weights(foreign, "dfd-net")
    assert len(caught.value.problems) > 5


def test_numbers_that_are_none_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "nan.safetensors"
    network = build_network("dfd-net", {"filters": list(SMALL)})
    with torch.no_grad():
        next(network.parameters()).fill_(float("nan"))
    save_weights(path, network, card())
    with pytest.raises(MethodError, match="nan or infinity in"):
        load_weights(path, "dfd-net")
    with pytest.raises(MethodError, match="no such weights"):
        load("dfd-net", weights=5)


def test_an_architecture_of_another_version_is_told(tmp_path: Path) -> None:
    path = tmp_path / "bogus.safetensors"
    made = card().model_copy(update={"architecture": {"bogus": 1}})
    save_weights(path, build_network("dfd-net", {"filters": list(SMALL)}), made)
    with pytest.raises(MethodError, match="architecture cannot be built"):
        load_weights(path, "dfd-net")


def test_tensors_of_other_shapes_are_named(tmp_path: Path) -> None:
    path = tmp_path / "other.safetensors"
    wider = [8 if number == 4 else number for number in SMALL]
    save_weights(path, build_network("dfd-net", {"filters": wider}), card())
    with pytest.raises(MethodError, match="do not fit the architecture") as caught:
        load_weights(path, "dfd-net")
    assert "entry" in str(caught.value) or "decode" in str(caught.value)


def test_no_weights_says_how_to_come_by_some(tmp_path: Path) -> None:
    with pytest.raises(MethodError, match="dfdbench train dfd-net") as caught:
        load("dfd-net")
    assert "--param weights=demo" in str(caught.value)
    with pytest.raises(MethodError, match="no such weights"):
        load("u-net", weights=str(tmp_path / "nowhere.safetensors"))


@pytest.mark.parametrize("method", ["dfd-net", "u-net"])
def test_shipped_weights_are_small_and_say_what_they_are(method: str) -> None:
    path = find_weights(method, "demo")
    assert path in shipped_weights().values()
    assert path.stat().st_size < 4_000_000
    _, found = load_weights(path, method)
    assert found.trained_on == "demo-1, split train"
    assert found.scored_on == "test, 54 pairs"
    assert path.with_suffix(".md").exists()


def test_a_run_keeps_the_weights_hash_and_warns_of_another_recipe(
    weights: Path, tiny_store: Store, tmp_path: Path
) -> None:
    method = load_for(tiny_store, "dfd-net", {"weights": str(weights), "device": "cpu"})
    result = run_method(tiny_store, method, "test", tmp_path / "run").result
    assert result.complete
    assert result.method.weights_sha256 == method.weights_sha256
    assert result.method.parameters["weights"] == "mine.safetensors"
    assert not [text for text in result.warnings if "recipe" in text]
    other = tmp_path / "text.safetensors"
    save_weights(other, load_weights(weights, "dfd-net")[0], card(recipe="text"))
    method = load_for(tiny_store, "dfd-net", {"weights": str(other), "device": "cpu"})
    result = run_method(tiny_store, method, "test", tmp_path / "other").result
    expected = "trained on the blur recipe text, run on the blur recipe published"
    assert expected in result.warnings


def test_other_weights_under_the_same_name_are_another_run(
    weights: Path, tiny_store: Store, tmp_path: Path
) -> None:
    parameters = {"weights": str(weights), "device": "cpu"}
    run_method(tiny_store, load_for(tiny_store, "dfd-net", parameters), "test", tmp_path / "run")
    torch.manual_seed(9)
    save_weights(weights, build_network("dfd-net", {"filters": list(SMALL)}), card())
    method = load_for(tiny_store, "dfd-net", parameters)
    done = run_method(tiny_store, method, "test", tmp_path / "run")
    assert done.reused == 0
    assert done.set_aside is not None


def test_falling_back_to_tiles_is_said(
    weights: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    predict = load("dfd-net", weights=str(weights), device="cpu")
    forward = predict._predict._forward  # type: ignore[attr-defined]

    def short(pixels: Any) -> Any:
        if max(pixels.shape[:2]) > 200:
            raise RuntimeError("CUDA out of memory.")
        return forward(pixels)

    monkeypatch.setattr(predict._predict, "_forward", short)  # type: ignore[attr-defined]
    image = np.zeros((150, 300, 3), np.uint8)
    assert predict(image, image).shape == (150, 300)
    assert "out of memory: went on in tiles of" in capsys.readouterr().out


def test_without_torch_the_error_says_what_to_install(tmp_path: Path) -> None:
    # A module of that name that cannot be imported, as where it is not installed.
    code = (
        "import sys; sys.modules['torch'] = None\n"
        "from dfdbench.cli import main\n"
        "sys.argv = ['dfdbench', *sys.argv[1:]]\n"
        "main()\n"
    )
    for arguments in (["check-method", "dfd-net"], ["train", "dfd-net", "--dataset", "demo"]):
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, text=True, cwd=tmp_path
        )
        assert done.returncode == 2, done.stderr
        assert "torch is not installed" in done.stderr
        assert "pip install 'dfdbench[nets]'" in done.stderr
