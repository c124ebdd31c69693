from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.datasets.store import Store
from dfdbench.errors import InputError, MethodError
from dfdbench.methods.networks.weights import build_network, count_parameters, save_weights
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.configuration_file import read_configuration
from dfdbench.training.reduction.reduce import BASELINE, reduce_weights
from tests.methods.made_weights import card, save_small
from tests.methods.networks.test_architectures import SMALL


def test_weights_become_configurations_of_narrower_networks(
    tiny_store: Store, tmp_path: Path
) -> None:
    choices = TrainingConfiguration(narrow=8, crop=16, steps=3)
    found = reduce_weights(save_small(tmp_path / "w.safetensors"), tiny_store, choices)
    assert list(found.rows)[:2] == [BASELINE, "B-01-01"]
    assert len(found.rows) == 10
    assert found.rows[BASELINE] == tuple(SMALL)
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "F-01-01.toml").write_text("old")
    found.write(folder)
    assert {path.name for path in folder.iterdir()} == set(found.files) | {
        "counts.md",
        "counts.csv",
        "rows.md",
        "rows.csv",
    }
    for name, widths in found.rows.items():
        read = read_configuration(str(folder / f"{name}.toml"))
        assert read == choices.model_copy(update={"filters": list(widths), "narrow": 1})
        built = build_network("dfd-net", read.architecture("dfd-net"))
        parameters = dict(zip(found.rows, found.tables[1].rows, strict=True))[name][-1]
        assert f"{count_parameters(built):,}" == parameters
    assert "counted on tiny-1, split test" in (folder / "B-01-01.toml").read_text()


def test_layers_stay_what_they_are_and_rounding_adds_rows(
    tiny_store: Store, tmp_path: Path
) -> None:
    architecture = {"filters": list(SMALL), "sampling_size": 3, "first_activation": "sigmoid"}
    path = tmp_path / "w.safetensors"
    save_weights(path, build_network("dfd-net", architecture), card(architecture=architecture))
    found = reduce_weights(
        path, tiny_store, TrainingConfiguration(), level=2, rounding="L", split="train"
    )
    assert list(found.rows)[1:] == [f"F2-0{n}-0{m}" for n in (1, 2, 3) for m in (1, 2)] + [
        f"F2-0{n}-0{m}L" for n in (1, 2, 3) for m in (1, 2)
    ]
    for text in found.files.values():
        assert "sampling_size = 3\n" in text
        assert 'first_activation = "sigmoid"\n' in text


def test_weights_of_another_network_and_unknown_levels_are_refused(
    tiny_store: Store, tmp_path: Path
) -> None:
    unet = {"filters": [2, 4, 8, 16, 32]}
    path = tmp_path / "u.safetensors"
    save_weights(path, build_network("u-net", unet), card(method="u-net", architecture=unet))
    with pytest.raises(MethodError, match="weights of another architecture"):
        reduce_weights(path, tiny_store, TrainingConfiguration())
    small = save_small(tmp_path / "w.safetensors")
    with pytest.raises(InputError, match="no such level"):
        reduce_weights(small, tiny_store, TrainingConfiguration(), level=4)
