from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.errors import InputError
from dfdbench.methods.networks.widths import FILTERS
from dfdbench.training.configuration_file import read_configuration, shipped_configurations


@pytest.mark.parametrize("name", shipped_configurations())
def test_every_shipped_configuration_can_be_read(name: str) -> None:
    read_configuration(name).architecture("dfd-net")


def test_a_file_and_changes_to_it(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('filters = "F-02-02"\nnoise = 1\n')
    read = read_configuration(str(path), {"noise": 3, "betas": [0.9, 0.999]})
    assert (read.noise, read.betas) == (3.0, (0.9, 0.999))
    assert read.architecture("dfd-net")["filters"] == list(FILTERS["F-02-02"])


def test_every_problem_of_a_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('crop = 3\nnoice = 1\nprecision = "int8"\nlearning_rate = -1\n')
    with pytest.raises(InputError) as caught:
        read_configuration(str(path))
    text = str(caught.value)
    assert len(caught.value.problems) == 4
    for word in ("crop", "noice", "precision", "learning_rate", "mine.toml"):
        assert word in text


def test_what_is_no_configuration(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="demo, published"):
        read_configuration("publisht")
    path = tmp_path / "mine.toml"
    path.write_text("crop = = 3")
    with pytest.raises(InputError, match="not a TOML file"):
        read_configuration(str(path))
    with pytest.raises(InputError, match="needs steps"):
        read_configuration("published", {"schedule": "cosine"})
    with pytest.raises(InputError, match="F-02-02"):
        read_configuration("published", {"filters": "F-99"})


def test_a_file_nested_too_deep_is_told(tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    path.write_text("noise = " + "[" * 3000)
    with pytest.raises(InputError, match="nested too deep"):
        read_configuration(str(path))
