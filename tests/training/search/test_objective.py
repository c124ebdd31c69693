from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.datasets.store import Store
from dfdbench.methods.networks.architectures import DfDNet
from dfdbench.methods.networks.inference import Predictor
from dfdbench.training.scoring import mean_scores
from dfdbench.training.search import objective as module
from dfdbench.training.search.objective import mean_parts, objective
from tests.methods.networks.test_architectures import SMALL

CPU = torch.device("cpu")


def test_eq_6_1_by_hand() -> None:
    train = {"nrmse": 0.06, "nmae": 0.02, "ssim": 0.9}
    test = {"nrmse": 0.10, "nmae": 0.04, "ssim": 0.8}
    assert objective(train, test, 0.3) == pytest.approx(0.3 * 0.18 + 0.7 * 0.34)
    assert objective(train, test, 1.0) == pytest.approx(0.18)
    for broken in ({}, test | {"ssim": math.nan}, {"nrmse": 0.1, "nmae": 0.1}):
        assert objective(train, broken, 0.3) == math.inf
        assert objective(broken, test, 1.0) == math.inf


def network() -> Any:
    torch.manual_seed(3)
    return DfDNet(SMALL).eval()


def test_whole_images_are_scored_as_trainings_are(tiny_store: Store) -> None:
    pairs = tiny_store.pairs("test")[:3]
    found = mean_parts(network(), tiny_store, pairs, CPU, "mode", centre=False)
    assert found == mean_scores(network(), tiny_store, pairs, CPU)["thesis"]


def test_the_author_scores_the_centre_and_divides_by_255(
    tiny_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "CENTRE", (16, 400))  # the images have 24 rows and 30 columns
    (pair,) = tiny_store.pairs("test")[:1]
    images = tiny_store.read(pair)
    levels = Predictor(network(), CPU)(images.infocus, images.defocus)
    depth, answer = images.depth[4:20], levels[4:20].astype(np.float32)
    found = mean_parts(network(), tiny_store, [pair], CPU, "mode", centre=True)
    errors = answer.astype(float) - depth
    assert found["nmae"] == pytest.approx(np.abs(errors).mean() / 255, abs=1e-6)
    assert found["nrmse"] == pytest.approx(np.sqrt((errors**2).mean()) / 255, abs=1e-6)
    whole = mean_parts(network(), tiny_store, [pair], CPU, "mode", centre=False)
    assert found["ssim"] != whole["ssim"]
