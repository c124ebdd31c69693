from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip("torch", reason="needs the extra nets")

from dfdbench.errors import InputError
from dfdbench.methods.networks.architectures import DfDNet
from dfdbench.methods.networks.choices import SITES, SIZED, checked_kernels
from tests.methods.networks.test_architectures import SMALL


def test_sizes_are_those_of_the_thesis_s_layers() -> None:
    assert SIZED == (52, 48, 45, 40, 37, 32, 29, 24, 20, 17, 12, 8, 5, 1)
    assert len(SITES) == 9
    assert checked_kernels([1, *[3] * 12, [5, 7]])[1] == (5, 7)


@pytest.mark.parametrize(
    ("choice", "told"),
    [
        ({"kernels": [3] * 13}, "14 of them, for layers 52, 48"),
        ({"kernels": [4] + [3] * 13}, "an odd number up to 9"),
        ({"kernels": [11] + [3] * 13}, "an odd number up to 9"),
        ({"kernels": [[3, 3, 3]] + [3] * 13}, "rows and columns"),
        ({"activations": ["relu"] * 8}, "9 of them"),
        ({"activations": ["swish"] * 9}, "relu or prelu or sigmoid or tanh or elu or srelu"),
        ({"first_activation": "swish"}, "first_activation"),
        ({"normalized": [True] * 8}, "9: entry, encode_1"),
    ],
)
def test_what_is_no_choice_is_told(choice: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        DfDNet(SMALL, **choice)
