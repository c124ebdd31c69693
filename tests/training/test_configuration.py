from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.blur.tracks import TRACKS
from dfdbench.errors import InputError
from dfdbench.methods.networks.weights import find_weights, load_weights
from dfdbench.methods.networks.widths import FILTERS
from dfdbench.training.configuration import (
    TrainingConfiguration,
    read_configuration,
    shipped_configurations,
)


def test_the_published_configuration_is_the_thesis_and_the_default() -> None:
    published = read_configuration("published")
    assert published == TrainingConfiguration()
    assert (published.crop, published.learning_rate, published.betas) == (32, 1e-4, (0.5, 0.99))
    assert (published.weight_decay, published.patience, published.shrink) == (0.0005, 2500, 0.1)
    assert published.minimum_learning_rate == 1e-10
    assert published.architecture("dfd-net") == {
        "filters": list(FILTERS["original"]),
        "sampling_size": 2,
        "first_activation": "prelu",
    }
    assert published.architecture("u-net") == {"filters": [64, 128, 256, 512, 1024]}


def test_the_captures_are_trained_with_more_patience_and_nothing_else() -> None:
    changed = read_configuration("published", {"patience": 3000})
    assert read_configuration("published-realworld") == changed


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


def test_unet_refuses_what_only_dfd_net_has() -> None:
    choices = TrainingConfiguration(sampling_size=3, first_activation="sigmoid", filters="F-02-02")
    with pytest.raises(InputError) as caught:
        choices.architecture("u-net")
    assert len(caught.value.problems) == 3


@pytest.mark.parametrize(
    ("method", "weights", "name", "changes", "first"),
    [
        ("dfd-net", "demo", "demo-fine", {}, "demo-1, split train, 30,000 steps"),
        (
            "u-net",
            "demo",
            "demo-u-net",
            {"label_width": 3, "learning_rate": 4e-4, "steps": 33000},
            "demo-1, split train, 40,000 steps",
        ),
        (
            "dfd-net",
            "middlebury",
            "demo-fine",
            {"label_width": 2, "steps": 13000, "readout": "median", "evaluate_every": 6500},
            "middlebury-default-1, split train, 16,000 steps",
        ),
    ],
)
def test_shipped_weights_were_trained_as_the_docs_say(
    method: str, weights: str, name: str, changes: dict[str, Any], first: str
) -> None:
    card = load_weights(find_weights(method, weights), method)[1]
    # All were trained on a processor with bf16, which `auto` takes there.
    documented = read_configuration(name, {**changes, "precision": "bf16"})
    assert TrainingConfiguration.model_validate(card.configuration) == documented
    assert card.started_from.startswith(first)


def test_robust_is_demo_on_every_track() -> None:
    demo, robust = read_configuration("demo"), read_configuration("robust")
    assert robust == demo.model_copy(update={"tracks": tuple(TRACKS)})
    with pytest.raises(InputError, match=r"any of noise, psf.*got nois"):
        read_configuration("robust", {"tracks": ["nois"]})
