"""Weights of a small network, and their card; for tests that have torch."""

from pathlib import Path
from typing import Any

import torch

from dfdbench.methods.networks.weights import Card, build_network, save_weights
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


def save_small(path: Path) -> Path:
    """Write weights drawn from seed 2."""
    torch.manual_seed(2)
    save_weights(path, build_network("dfd-net", {"filters": list(SMALL)}), card())
    return path
