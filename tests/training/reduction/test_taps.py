from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch
from torch import Tensor

from dfdbench.errors import InputError, MethodError
from dfdbench.methods.networks.architectures import DfDNet, UNet
from dfdbench.methods.networks.widths import LAYERS
from dfdbench.training.reduction.taps import TAPS, tap, tapped_modules
from tests.methods.networks.test_architectures import SMALL

RANDOM = np.random.default_rng(0)
INFOCUS, DEFOCUS = (RANDOM.integers(0, 256, (26, 33, 3)).astype(np.uint8) for _ in range(2))


def network() -> DfDNet:
    torch.manual_seed(4)
    return DfDNet(SMALL).eval()


@torch.inference_mode()
def by_hand(made: DfDNet) -> dict[int, Tensor]:
    """Fig. 5.5 and 6.2, step by step, on the image cut to multiples of 4."""
    both = np.concatenate([INFOCUS, DEFOCUS], 2)[:24, :32].transpose(2, 0, 1)
    at = {52: made.entry(made.pixels(torch.from_numpy(both.copy())[None].float()))}
    at[48] = made.encode_1.first(at[52])
    at[45] = at[52] + made.encode_1.second(at[48])
    at[42] = made.down_1(at[45])
    at[40] = made.encode_2.first(at[42])
    at[37] = at[42] + made.encode_2.second(at[40])
    at[34] = made.down_2(at[37])
    at[32] = made.bottom.first(at[34])
    at[29] = at[34] + made.bottom.second(at[32])
    at[27] = made.up_2(at[29])
    at[24] = made.merge_2(torch.cat((at[27], at[37]), 1))
    at[20] = made.decode_2.first(at[24])
    at[17] = at[24] + made.decode_2.second(at[20])
    at[15] = made.up_1(at[17])
    at[12] = made.merge_1(torch.cat((at[15], at[45]), 1))
    at[8] = made.decode_1.first(at[12])
    at[5] = at[12] + made.decode_1.second(at[8])
    at[2] = made.activate(made.normalize(at[5]))
    return at


def test_each_layer_is_tapped_where_the_thesis_says() -> None:
    made = network()
    expected, found = by_hand(made), tap(made, INFOCUS, DEFOCUS)
    assert list(found) == list(TAPS) == [*LAYERS[:-1], 2]
    for layer, maps in expected.items():
        vectors = maps[0].flatten(1).double()
        assert found[layer].pixels == vectors.shape[1]
        assert found[layer].gram == pytest.approx((vectors @ vectors.T).numpy(), rel=1e-6)
    # Nothing is left hanging on the network.
    assert not any(module._forward_hooks for module in made.modules())


def test_a_network_without_the_layers_is_named() -> None:
    with pytest.raises(MethodError, match=r"(?s)layer 52.*UNet") as caught:
        tapped_modules(UNet((2, 4, 8, 16, 32)))
    assert len(caught.value.problems) == len(TAPS)
    cut = network()
    del cut.activate
    with pytest.raises(MethodError, match="layer 2"):
        tap(cut, INFOCUS, DEFOCUS)


def test_a_sample_of_fewer_pixels_than_filters_is_named_by_layer() -> None:
    wide = DfDNet((*[8] * 6, 9, 4, 9, *[8] * 8, 256)).eval()
    with pytest.raises(InputError, match=r"(?s)layer 34.*at least 9 pixels") as caught:
        tap(wide, INFOCUS[:8, :16], DEFOCUS[:8, :16])
    assert [problem.where for problem in caught.value.problems] == ["layer 34", "layer 29"]
    with pytest.raises(InputError, match="at least 4 x 4"):
        tap(wide, INFOCUS[:3], DEFOCUS[:3])


def test_outputs_that_are_no_numbers_are_named() -> None:
    broken = network()
    with torch.no_grad():
        broken.up_1.weight.fill_(float("inf"))  # type: ignore[operator]
    with pytest.raises(InputError, match="layer 15"):
        tap(broken, INFOCUS, DEFOCUS)
