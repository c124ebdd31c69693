"""Inference of the networks against the plain forward; nothing is asserted of times."""

import time
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.methods.networks.inference import Predictor, find_device
from dfdbench.methods.networks.weights import find_weights, load_weights
from tests.benchmarks.ledger import Ledger, cpu
from tests.one_torch_thread import one_torch_thread
from tests.process import python

__all__ = ["one_torch_thread"]

DEVICE = find_device("auto")


MEGAPIXEL = (1000, 1000)
#: The peak memory of a process that has PyTorch and the network, before and after a megapixel.
PEAKS = f"""
import numpy, torch
from dfdbench.methods.learned import DfDNetMethod
torch.set_num_threads(1)
network = DfDNetMethod(weights="demo", readout="median", device="cpu")
for shape in ((64, 64), {MEGAPIXEL}):
    network(*[numpy.random.default_rng(0).integers(0, 256, (*shape, 3)).astype("u1")] * 2)
    # Not of getrusage, which counts what the parent held.
    print(*[int(line.split()[1]) // 1024 for line in open("/proc/self/status") if "VmHWM" in line])
"""


@pytest.mark.benchmark(timer=time.process_time)
def test_a_megapixel(benchmark: Any, ledger: Ledger) -> None:
    """The shipped network's median against the same network in plain PyTorch."""
    network = load_weights(find_weights("dfd-net", "demo"), "dfd-net")[0].to(DEVICE)
    random = np.random.default_rng(0)
    infocus, defocus = (random.integers(0, 256, (*MEGAPIXEL, 3)).astype(np.uint8) for _ in "ab")

    def plain() -> Any:
        both = np.concatenate([infocus, defocus], 2).transpose(2, 0, 1)
        with torch.no_grad():
            logits = network(torch.from_numpy(both.copy()).float()[None].to(DEVICE))[0]
            return (logits.softmax(0).cumsum(0) < 0.5).sum(0).cpu().numpy()

    expected = plain()
    theirs = cpu(plain)
    predict = Predictor(network, DEVICE, readout="median")
    levels = benchmark.pedantic(predict, (infocus, defocus), rounds=2, warmup_rounds=1)
    before, after = map(int, python("-c", PEAKS).stdout.split())
    print(f"\na megapixel: peak {before} MB before it, {after} MB after")
    title, peer = "DfD-Net's median level, a megapixel", "forward, softmax, cumsum"
    differing = int((levels != expected).sum())
    result = f"{differing} of 1e6 levels differ by a rounding"
    ledger.note(title, benchmark.stats["min"], "torch", peer, theirs, result)
    # Sums in another order: pixels whose median lies on the edge of two levels.
    assert (levels != expected).mean() < 1e-4
