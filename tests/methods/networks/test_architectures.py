from typing import Any

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.errors import InputError
from dfdbench.methods.networks import architectures
from dfdbench.methods.networks.architectures import DfDNet, UNet
from dfdbench.methods.networks.choices import FILTERS, LAYERS
from dfdbench.methods.networks.weights import count_parameters

# Fig. 5.5, input to output: the thesis's layer number, channels in and out, filter size.
PUBLISHED = [
    (52, 6, 128, 3), (48, 128, 128, 3), (45, 128, 128, 3), (42, 128, 256, 2),
    (40, 256, 256, 3), (37, 256, 256, 3), (34, 256, 512, 2), (32, 512, 512, 3),
    (29, 512, 512, 3), (27, 512, 256, 2), (24, 512, 256, 3), (20, 256, 256, 3),
    (17, 256, 256, 3), (15, 256, 128, 2), (12, 256, 128, 3), (8, 128, 128, 3),
    (5, 128, 128, 3), (1, 128, 256, 3),
]  # fmt: skip
SMALL = (4, 3, 4, 6, 5, 6, 8, 7, 8, 6, 6, 5, 6, 4, 4, 3, 4, 256)


def convolutions(network: torch.nn.Module) -> list[Any]:
    kinds = (torch.nn.Conv2d, torch.nn.ConvTranspose2d)
    return [module for module in network.modules() if isinstance(module, kinds)]


def test_dfd_net_layer_by_layer() -> None:
    with torch.device("meta"):
        found = convolutions(DfDNet())
    assert len(found) == 18
    for module, (layer, before, after, size) in zip(found, PUBLISHED, strict=True):
        assert (module.in_channels, module.out_channels) == (before, after), layer
        assert module.kernel_size == (size, size), layer
        assert module.stride == ((2, 2) if size == 2 else (1, 1)), layer
    assert tuple(layer for layer, *_ in PUBLISHED) == LAYERS


#: Counted from the widths by hand; of ``pso``, from its author's generated headers.
PARAMETERS = {
    "original": 10_761_353, "B-01-01": 1_727_497, "B-01-02": 2_282_899, "B-01-03": 2_218_159,
    "B-02-01": 1_944_353, "B-02-02": 2_524_333, "B-02-03": 2_480_543, "B-03-01": 2_172_401,
    "B-03-02": 2_765_665, "B-03-03": 2_747_717, "F-01-01": 1_881_401, "F-01-02": 2_067_081,
    "F-02-01": 2_112_869, "F-02-02": 2_279_429, "F-03-01": 1_999_951, "F-03-02": 2_166_337,
    "F-02-02L": 2_292_049, "F-02-02H": 2_345_481, "pso": 7_665_636,
}  # fmt: skip


@pytest.mark.parametrize("name", FILTERS)
def test_every_named_network_has_its_parameters(name: str) -> None:
    first = "sigmoid" if name == "pso" else "prelu"
    with torch.device("meta"):
        network = DfDNet(FILTERS[name], first_activation=first)
    assert tuple(module.out_channels for module in convolutions(network)) == FILTERS[name]
    assert count_parameters(network) == PARAMETERS[name]


def test_each_choice_of_a_particle_changes_what_it_should() -> None:
    plain = count_parameters(DfDNet(SMALL))
    # One scale and one shift a filter against one bias, but for the last: its bias stays.
    bare = DfDNet(SMALL, normalized=[False] * 9)
    sites = [SMALL[layer] for layer in (0, 1, 4, 7, 10, 11, 14, 15)]
    assert plain - count_parameters(bare) == sum(sites) + 2 * SMALL[16]
    counts = {"relu": -9, "sigmoid": -9, "tanh": -9, "elu": -9, "prelu": 0, "srelu": 27}
    for name, more in counts.items():
        assert count_parameters(DfDNet(SMALL, activations=[name] * 9)) - plain == more, name
    kernels: list[int | list[int]] = [3] * 14
    kernels[1] = [9, 1]
    assert count_parameters(DfDNet(SMALL, kernels=kernels)) == plain
    sizes = [module.kernel_size for module in convolutions(DfDNet(SMALL, kernels=kernels))]
    assert [number for number, size in enumerate(sizes) if size == (9, 1)] == [1]


def test_a_network_of_any_choices_learns_and_keeps_the_size() -> None:
    torch.manual_seed(0)
    kinds = ["srelu", "elu", "tanh", "relu", "prelu", "sigmoid", "srelu", "elu", "tanh"]
    bits = [True, False] * 4 + [True]
    network = DfDNet(SMALL, kernels=[9] * 14, activations=kinds, normalized=bits)
    # The bottom of a patch of 12 has three pixels a side, the filters nine.
    logits = network(torch.rand(2, 6, 12, 12) * 255)
    assert logits.shape == (2, 256, 12, 12)
    logits.square().mean().backward()
    gradients = [parameter.grad for parameter in network.parameters()]
    assert all(grad is not None and bool(grad.isfinite().all()) for grad in gradients)


def test_filters_that_do_not_fit_are_named() -> None:
    wrong = (*SMALL[:2], 5, *SMALL[3:12], 9, *SMALL[13:])
    with pytest.raises(InputError) as caught:
        DfDNet(wrong)
    assert [problem.what.partition(" are ")[0] for problem in caught.value.problems] == [
        "layers 52 and 45",
        "layers 24 and 17",
    ]
    for few in (SMALL[:-1], (*SMALL[:-1], 100)):
        with pytest.raises(InputError, match="18 positive numbers"):
            DfDNet(few)


def test_unet_is_ronnebergers_with_six_channels_and_256_classes() -> None:
    with torch.device("meta"):
        plain, normalized = UNet(), UNet(normalized=True)
    found = convolutions(plain)
    assert (found[0].in_channels, found[-1].out_channels) == (6, 256)
    assert len(found) == 5 * 2 + 4 + 4 * 2 + 1
    assert count_parameters(plain) == 31_050_048
    # Two numbers for each of the 2 x 2,944 channels that are normalized.
    assert count_parameters(normalized) == 31_050_048 + 2 * 2 * (1984 + 960)
    with pytest.raises(InputError, match="the last four even"):
        UNet(filters=(4, 8, 16, 32, 63))


def test_u_net_keeps_its_signals_size() -> None:
    torch.manual_seed(0)
    with torch.no_grad():
        logits = UNet((16, 32, 64, 128, 256))(torch.rand(2, 6, 64, 64) * 255)
    assert 0.05 < float(logits.std()) < 5


def test_folding_changes_no_answer_and_leaves_one_normalization() -> None:
    torch.manual_seed(0)
    network = DfDNet(SMALL)
    pixels = torch.rand(4, 6, 16, 16) * 255
    for _ in range(5):  # running means that are not 0 and 1
        network(pixels)
    network.eval()
    with torch.no_grad():
        before = network(pixels)
        architectures.fold_batch_norm(network)
        assert torch.allclose(network(pixels), before, atol=1e-4)
    kinds = [type(module).__name__ for module in network.modules()]
    assert kinds.count("BatchNorm2d") == 1  # after a sum, before no convolution


@pytest.mark.parametrize("kind", ["dfd-net", "u-net"])
def test_filters_from_differences_do_not_see_brightness(kind: str) -> None:
    torch.manual_seed(0)
    network = DfDNet(SMALL) if kind == "dfd-net" else UNet((4, 8, 16, 32, 64))
    sharp = torch.randint(0, 256, (2, 3, 32, 32)).float()
    pixels = torch.cat([sharp, sharp + torch.randn(2, 3, 32, 32)], 1)
    architectures.start_from_differences(network, pixels)
    flat = torch.rand(1, 3, 1, 1).expand(1, 3, 9, 9)
    answer = network.first(torch.cat([flat, flat], 1))[:, :, 1:-1, 1:-1]
    assert answer.abs().max() < 1e-4
    # What is small in the images is as large in the answers as all else.
    deviations = network.first(network.pixels(pixels)).std((0, 2, 3))
    assert torch.allclose(deviations, torch.ones_like(deviations), atol=1e-3)
