import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("torch", reason="needs the extra nets")
import torch
from hypothesis import given
from hypothesis import strategies as st

from dfdbench.errors import MethodError
from dfdbench.methods.networks import architectures, inference
from dfdbench.methods.networks.architectures import DfDNet, UNet
from dfdbench.methods.networks.inference import Predictor, Readout, find_device, median_levels
from tests.methods.networks.test_architectures import SMALL

CPU = torch.device("cpu")


def network(kind: str = "dfd-net") -> torch.nn.Module:
    torch.manual_seed(1)
    made = DfDNet(SMALL) if kind == "dfd-net" else UNet((4, 4, 4, 4, 4))
    return made.eval()


def images(rows: int, columns: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    random = np.random.default_rng(rows * 1000 + columns)
    infocus = random.integers(0, 256, (rows, columns, 3)).astype(np.uint8)
    return infocus, random.integers(0, 256, (rows, columns, 3)).astype(np.uint8)


@pytest.mark.parametrize("kind", ["dfd-net", "u-net"])
@pytest.mark.parametrize("shape", [(1, 1), (3, 50), (17, 16), (37, 46)])
def test_any_size_goes_in_and_comes_out(kind: str, shape: tuple[int, int]) -> None:
    levels = Predictor(network(kind), CPU)(*images(*shape))
    assert levels.shape == shape
    assert levels.dtype == np.uint8


@pytest.mark.parametrize("kind", ["dfd-net", "u-net"])
def test_tiles_do_not_change_the_answer(kind: str) -> None:
    pair = images(150, 331)
    whole = Predictor(network(kind), CPU)(*pair)
    assert len(np.unique(whole)) > 1
    assert np.array_equal(Predictor(network(kind), CPU, tile=64)(*pair), whole)


@given(st.integers(0, 2**32 - 1))
def test_the_median_errs_least_on_average(seed: int) -> None:
    random = np.random.default_rng(seed)
    logits = random.normal(0, random.uniform(0.1, 8), (256, 3, 4)).astype(np.float32)
    chosen = median_levels(torch.from_numpy(logits).permute(1, 2, 0)).numpy().astype(int)
    exact = np.exp(logits.astype(float) - logits.max(0))
    exact /= exact.sum(0)
    levels = np.arange(256)
    expected = np.einsum("lyx,lk->kyx", exact, np.abs(levels[:, None] - levels[None]))
    found = np.take_along_axis(expected, chosen[None], 0)[0]
    assert np.all(found <= expected.min(0) + 1e-3)


def farthest_seen(
    made: torch.nn.Module, monkeypatch: pytest.MonkeyPatch, places: tuple[int, ...] = (128,)
) -> int:
    made = made.double()
    with torch.no_grad():  # no unit is dead, so that all that can be seen is seen
        for parameter in made.parameters():
            parameter.abs_()
    made.pixels = torch.nn.Identity()
    monkeypatch.setattr(architectures, "in_float32", lambda layers, given: layers(given))
    farthest = 0
    for place in places:
        pixels = torch.rand(1, 6, 256, 256, dtype=torch.float64, requires_grad=True)
        made(pixels)[0, :, place, place].sum().backward()
        assert pixels.grad is not None
        seen = torch.nonzero(pixels.grad[0].abs().sum(0))
        farthest = max(farthest, int((seen - place).abs().max()))
    return farthest


@pytest.mark.slow
def test_the_margin_is_as_far_as_a_pixel_sees(monkeypatch: pytest.MonkeyPatch) -> None:
    assert farthest_seen(network("dfd-net"), monkeypatch, EVERY) == DfDNet(SMALL).margin
    assert 0.7 * UNet.margin < farthest_seen(network("u-net"), monkeypatch) <= UNet.margin


#: Halving and doubling treat pixels alike only every fourth.
EVERY = (126, 127, 128, 129)
#: By the thesis's layers, input to output; larger above than below, upright and lying.
WIDE: list[int | list[int]] = [
    9, 7, [9, 5], 5, [3, 9], [1, 7], 9, 3, 5, [7, 1], [1, 9], 9, [5, 7], 3
]  # fmt: skip


@pytest.mark.slow
def test_the_margin_follows_the_filters(monkeypatch: pytest.MonkeyPatch) -> None:
    for kernels, sampling in ((WIDE, 2), ([1] * 14, 2), (None, 1), (None, 5)):
        made = DfDNet(SMALL, sampling, kernels=kernels, activations=["prelu"] * 9).eval()
        assert farthest_seen(made, monkeypatch, EVERY) == made.margin


@pytest.mark.parametrize("readout", ["mode", "median"])
def test_what_would_take_much_memory_goes_in_tiles_and_rows(
    readout: Readout, monkeypatch: pytest.MonkeyPatch
) -> None:
    pair = images(200, 300)
    whole = Predictor(network(), CPU, readout=readout)(*pair)
    held: list[int] = []

    def watch(_: torch.nn.Module, given: tuple[torch.Tensor], answer: torch.Tensor) -> None:
        held.append(answer.nelement() * answer.element_size())

    monkeypatch.setattr(inference, "_MOST_BYTES", 3_000_000)
    made = network()
    for module in made.modules():
        if not list(module.children()):
            module.register_forward_hook(watch)
    assert np.array_equal(Predictor(made, CPU, readout=readout)(*pair), whole)
    # Of the logits alone, the whole image's are 61 MB.
    assert max(held) < 4_000_000


def test_bf16_changes_few_pixels_by_much() -> None:
    pair = images(64, 64)
    exact = Predictor(network(), CPU)(*pair).astype(int)
    fast = Predictor(network(), CPU, precision="bf16")(*pair).astype(int)
    assert (exact == fast).mean() > 0.5


def test_wrong_choices_are_told() -> None:
    with pytest.raises(MethodError, match="float32 or bf16"):
        Predictor(network(), CPU, precision="int8")  # type: ignore[arg-type]
    for tile in (63, 64.5):
        with pytest.raises(MethodError, match="at least 64"):
            Predictor(network(), CPU, tile=tile)  # type: ignore[arg-type]
    with pytest.raises(MethodError, match=r"auto, .*cpu"):
        find_device("tpu")
