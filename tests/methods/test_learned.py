import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")

import torch
from torch import nn

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import MethodError
from dfdbench.evaluation.loading import load_for
from dfdbench.methods.networks.inference import Predictor
from dfdbench.methods.networks.weights import load_weights, save_weights
from dfdbench.methods.registry import load
from tests.methods.made_weights import card
from tests.process import dfdbench_without


def test_weights_know_their_hash_and_warn_of_another_recipe(
    weights: Path, tiny_store: Dataset, tmp_path: Path
) -> None:
    method = load_for(tiny_store, "dfd-net", {"weights": str(weights), "device": "cpu"})
    assert method.weights_sha256 == hashlib.sha256(weights.read_bytes()).hexdigest()
    assert not method.warnings
    # Trained on random tracks, it has seen more blurs than its set's.
    for configuration, warned in ({}, True), ({"tracks": ["psf"]}, False):
        other = tmp_path / "text.safetensors"
        made = card(recipe="text", configuration=configuration)
        save_weights(other, load_weights(weights, "dfd-net")[0], made)
        method = load_for(tiny_store, "dfd-net", {"weights": str(other), "device": "cpu"})
        expected = "trained on the blur recipe text, run on the blur recipe published"
        assert (expected in method.warnings) == warned


PAIR = np.random.default_rng(4).integers(0, 256, (2, 24, 30, 3)).astype(np.uint8)


def levels(path: Path, **parameters: Any) -> Any:
    return load("dfd-net", weights=str(path), device="cpu", **parameters)(*PAIR)


def test_weights_are_read_out_as_they_were_made_for(weights: Path, tmp_path: Path) -> None:
    other = tmp_path / "median.safetensors"
    made_for_median = card(configuration={"readout": "median"})
    save_weights(other, load_weights(weights, "dfd-net")[0], made_for_median)
    mode, median = levels(weights), levels(other)
    assert not np.array_equal(mode, median)
    assert np.array_equal(levels(weights, readout="median"), median)
    assert np.array_equal(levels(other, readout="mode"), mode)


def test_pixels_vote_within_the_image_s_edges(weights: Path, monkeypatch: Any) -> None:
    random = np.random.default_rng(2)
    depth = np.repeat([[40.0, 200.0]], 40, axis=0).repeat(30, axis=1)
    infocus = (depth[..., np.newaxis] + random.integers(-3, 4, (40, 60, 3))).astype(np.uint8)
    method: Any = load("dfd-net", weights=str(weights), device="cpu", strength=1e4)
    # Three pixels in ten are sure of the other depth.
    taken = np.where(random.random(depth.shape) < 0.3, depth[:, ::-1], depth)
    far = np.abs(np.arange(64) * 4 + 1.5 - taken[..., np.newaxis])
    monkeypatch.setattr(method._predict, "log_shares", lambda *_: -far.clip(0, 64) / 8)
    assert np.abs(method(infocus, infocus) - depth).max() < 3


def test_pixels_with_texture_count_more(weights: Path, monkeypatch: Any) -> None:
    textured = np.broadcast_to(np.arange(160) % 80 < 40, (40, 160))
    noise = np.random.default_rng(2).integers(-3, 4, (40, 160, 1))
    infocus = (90 + np.where(textured[..., np.newaxis], noise, 0) + np.zeros(3)).astype(np.uint8)
    voted = np.where(textured, 200.0, 40.0)
    far = np.abs(np.arange(64) * 4 + 1.5 - voted[..., np.newaxis])
    method: Any = load("dfd-net", weights=str(weights), device="cpu", strength=1e4)
    monkeypatch.setattr(method._predict, "log_shares", lambda *_: -far.clip(0, 64) / 8)
    assert np.abs(method(infocus, infocus) - 200).max() < 5


def test_votes_are_the_network_s_log_probabilities(weights: Path) -> None:
    network = load_weights(weights, "dfd-net")[0]
    pair = np.random.default_rng(5).integers(0, 256, (2, 24, 31, 3)).astype(np.uint8)
    given = torch.from_numpy(np.concatenate(pair, axis=2)[np.newaxis]).permute(0, 3, 1, 2).float()
    with torch.inference_mode():
        logits = network(nn.functional.pad(given, (0, 1, 0, 0), mode="reflect"))[
            0, :, :, :31
        ].numpy()
    shares = np.exp(logits - logits.max(0)) / np.exp(logits - logits.max(0)).sum(0)
    expected = np.log(shares.reshape(64, 4, 24, 31).sum(1) + 1e-4)
    found = Predictor(network, torch.device("cpu")).log_shares(*pair)
    np.testing.assert_allclose(np.moveaxis(found, 2, 0), expected, atol=0.02)


def test_the_mean_over_orientations_does_not_depend_on_the_turn_of_a_pair(weights: Path) -> None:
    pair = np.random.default_rng(5).integers(0, 256, (2, 24, 31, 3)).astype(np.uint8)
    one, mean = (
        load("dfd-net", weights=str(weights), device="cpu", orientations=number)
        for number in (1, 8)
    )
    found = mean(*pair)
    assert (found.dtype, found.shape) == (np.float32, (24, 31))
    turned = np.ascontiguousarray(np.rot90(pair, axes=(1, 2))[:, :, ::-1])
    assert np.array_equal(mean(*turned), np.rot90(found)[:, ::-1])
    assert not np.array_equal(one(*turned), np.rot90(one(*pair))[:, ::-1])
    answers = [
        np.rot90(one(*(np.ascontiguousarray(np.rot90(image, k)) for image in images)), -k)[:, ::way]
        for way in (1, -1)
        for images in [[np.ascontiguousarray(image[:, ::way]) for image in pair]]
        for k in range(4)
    ]
    assert np.array_equal(found, np.mean(answers, 0, np.float32))


def test_wrong_numbers_are_named_together(weights: Path) -> None:
    for wrong, number in ((0, -1), (2, 1e10), (8.0, 2e9), (True, True), ("8", "2")):
        with pytest.raises(MethodError) as caught:
            load("dfd-net", weights=str(weights), orientations=wrong, strength=number)
        named = [problem.where for problem in caught.value.problems]
        assert named == ["strength", "orientations"]


@pytest.mark.slow
def test_without_torch_the_error_says_what_to_install(tmp_path: Path) -> None:
    for arguments in (["check-method", "dfd-net"], ["train", "dfd-net", "--dataset", "demo"]):
        done = dfdbench_without("torch", *arguments, cwd=tmp_path)
        assert done.returncode == 2, done.stderr
        assert "torch is not installed" in done.stderr
        assert "pip install 'dfdbench[nets]'" in done.stderr
