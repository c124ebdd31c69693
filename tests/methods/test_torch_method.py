from pathlib import Path

import numpy as np
import pytest

from dfdbench.methods.calling import call
from dfdbench.methods.registry import load_method
from dfdbench.methods.torch_method import TorchMethod

NETWORK = """
import numpy as np
import torch

class Net(torch.nn.Module):
    trained_on = "nothing"

    def __init__(self):
        super().__init__()
        self.norm = torch.nn.BatchNorm2d(6)
        self.modes = []

    def fit(self, pairs):
        self.train()

    def forward(self, infocus, defocus, factor=1.0):
        self.modes.append((self.training, self.norm.training, torch.is_grad_enabled()))
        both = np.concatenate([infocus, defocus], 2).transpose(2, 0, 1)[None]
        return self.norm(torch.from_numpy(both.astype(np.float32)))[0, 0].clamp(0, 255) * factor

net = Net()

def with_gradient(infocus, defocus):
    return torch.full(infocus.shape[:2], 7.0, requires_grad=True)
"""


@pytest.fixture
def network(tmp_path: Path) -> Path:
    path = tmp_path / "network.py"
    path.write_text(NETWORK)
    return path


@pytest.mark.parametrize(("name", "factor"), [("Net", 1.0), ("net", 1.0), ("net", 0.5)])
def test_batch_norm_answers_as_it_learned(network: Path, name: str, factor: float) -> None:
    given = {} if factor == 1 else {"factor": factor}
    method = load_method(f"{network}:{name}", given, {})
    image = np.random.default_rng(0).integers(0, 256, (9, 12, 3)).astype(np.uint8)
    answer = call(method.predict, image, image)
    # In training mode it would be normalised to mean 0 and variance 1.
    assert answer.depth is not None
    assert np.allclose(answer.depth, image[..., 0] * factor, atol=0.01)


def test_a_fit_that_trains_leaves_no_trace(network: Path) -> None:
    method = load_method(f"{network}:Net", {}, {})
    assert method.trained_on == "nothing"
    method.fit([])
    image = np.zeros((9, 12, 3), np.uint8)
    assert call(method.predict, image, image).depth is not None
    assert isinstance(method.predict, TorchMethod)
    assert method.predict.modes == [(False, False, False)]


def test_a_tensor_with_a_gradient_is_taken(network: Path) -> None:
    image = np.zeros((9, 12, 3), np.uint8)
    depth = call(load_method(f"{network}:with_gradient", {}, {}).predict, image, image).depth
    assert depth is not None
    assert depth.tolist() == [[7.0] * 12] * 9
