from collections.abc import Mapping

import pytest
import torch

from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.configuration_file import read_configuration
from dfdbench.training.precision import precision_for, settled

CPU = torch.device("cpu")


@pytest.mark.parametrize(
    ("told", "precision", "said"),
    [
        ({"amx_bf16": True, "avx512_bf16": True}, "bf16", "amx_bf16"),
        ({"avx512_bf16": True, "amx_bf16": False}, "bf16", "avx512_bf16"),
        ({"avx512_f": True, "avx2": True}, "float32", "no fast bf16"),
        ({}, "float32", "no fast bf16"),
    ],
)
def test_a_processor_trains_in_what_it_does_fast(
    told: Mapping[str, bool], precision: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: told)
    found, reason = precision_for(CPU)
    assert found == precision
    assert said in reason
    assert settled(TrainingConfiguration(precision="auto"), CPU).precision == precision


def test_a_pytorch_that_cannot_be_asked_trains_in_float32(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(torch.cpu, "get_capabilities")
    assert precision_for(CPU)[0] == "float32"


@pytest.mark.parametrize("precision", ["float32", "bf16"])
def test_a_precision_that_was_named_stays(precision: str) -> None:
    chosen = TrainingConfiguration.model_validate({"precision": precision})
    assert settled(chosen, CPU) == chosen


@pytest.mark.parametrize("name", ["demo", "demo-fine", "demo-u-net"])
def test_shipped_configurations_suit_any_processor(name: str) -> None:
    assert read_configuration(name).precision == "auto"
