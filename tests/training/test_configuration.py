from pathlib import Path

import pytest
import torch

from dfdbench.blur.tracks import OF_PATCHES
from dfdbench.cli.options import values_of
from dfdbench.errors import InputError
from dfdbench.methods.networks.choices import FILTERS
from dfdbench.methods.networks.weights import find_weights, load_weights
from dfdbench.training.configuration import (
    TrainingConfiguration,
    precision_for,
    read_configuration,
    settled,
    shipped_configurations,
)


def test_the_published_configuration_is_the_thesis_and_the_default() -> None:
    published = read_configuration("published")
    assert published == TrainingConfiguration()
    assert (published.crop, published.learning_rate, published.betas) == (32, 1e-4, (0.5, 0.99))
    assert (published.weight_decay, published.patience, published.shrink) == (0.0005, 2500, 0.1)
    assert published.minimum_learning_rate == 1e-10
    assert (published.schedule, published.decay_prelu) == ("dlib", True)
    # 28 patches in eight orientations: 28 * 126,304 are the 3,536,511 of Fig. 5.8 but for one.
    assert (published.crops_per_step, published.expansion) == (28, "eight")
    usual = {"filters": list(FILTERS["original"]), "sampling_size": 2, "first_activation": "prelu"}
    assert published.architecture("dfd-net") == usual
    assert published.architecture("u-net") == {"filters": [64, 128, 256, 512, 1024]}
    narrow = {"narrow": 8, "normalized": True, "normalization": "fixed"}
    found = read_configuration("published", narrow).architecture("u-net")
    assert found == {"filters": [8, 16, 32, 64, 128], "normalized": True}
    with pytest.raises(InputError, match=r"no such choice(.|\n)*normalization"):
        read_configuration("published", {"normalization": "fixed"}).architecture("u-net")


def test_what_a_particle_describes_is_a_choice() -> None:
    kinds, bits = ["srelu", *["prelu"] * 8], [True] * 8 + [False]
    changes = {"kernels": [[1, 9], *[3] * 13], "activations": kinds, "normalized": bits}
    read = read_configuration("published", {**changes, "crop": 12})
    found = read.architecture("dfd-net")
    assert found["kernels"] == [[1, 9], *[[3, 3]] * 13]
    assert (found["activations"], found["normalized"]) == (kinds, bits)
    # As a card keeps it.
    assert TrainingConfiguration.model_validate(read.model_dump(mode="json")) == read
    with pytest.raises(InputError) as caught:
        read.architecture("u-net")
    assert len(caught.value.problems) == 3
    usual = {"kernels": [3] * 14, "activations": ["prelu"] * 9, "normalized": [True] * 9}
    published = read_configuration("published").architecture("dfd-net")
    assert read_configuration("published", usual).architecture("dfd-net") == published
    with pytest.raises(InputError, match="both say what comes first"):
        read_configuration("published", {"first_activation": "sigmoid", "activations": kinds})
    none = read_configuration("published", {"normalized": False}).architecture("dfd-net")
    assert none["normalized"] == [False] * 9
    for kernel in (0, -1, 2, 11, [3, 4]):
        with pytest.raises(InputError, match="kernels: odd numbers from 1 to 9"):
            read_configuration("published", {"kernels": [kernel, *[3] * 13]})
    for name, value in (("kernels", [3] * 13), ("activations", ["swish"] * 9), ("crop", 11)):
        with pytest.raises(InputError, match=name):
            read_configuration("published", {name: value})


#: Where and how far shipped weights were trained at first; then method, weights and choices.
SHIPPED = {
    "demo-1, split train, 30,000 steps": "dfd-net demo demo-fine",
    "demo-1, split train, 40,000 steps": "u-net demo demo-u-net label_width=3 "
    "learning_rate=4e-4 steps=33000",
    "middlebury-default-1, split train, 24,000 steps": "dfd-net middlebury demo-fine "
    "label_width=2 readout=median crop=128 crops_per_step=1 steps=36000 evaluate_every=18000",
    "middlebury-default-1, split train, 36,000 steps": "u-net middlebury demo-u-net "
    "normalized=true readout=median crop=128 crops_per_step=2 normalization=fixed "
    "label_width=2 learning_rate=8e-4 steps=16000 evaluate_every=4000",
    "dfd-indoor-1, split train, 9,000 steps": "dfd-net dfd-indoor demo-fine "
    "redraw_depth=false tilt=0 crop=128 crops_per_step=1 label_width=5 learning_rate=5e-4 "
    "unknown=ignore readout=median steps=9000 evaluate_every=3000",
    "demo-1, split train, random tracks, 14,000 steps": "dfd-net robust robust "
    "recipe=published steps=12000 evaluate_every=4000",
    "middlebury-default-1, split train, 16,000 steps": "u-net robust robust crop=96 "
    "normalized=true steps=12000 evaluate_every=4000",
}


@pytest.mark.parametrize(("first", "trained"), SHIPPED.items())
def test_shipped_weights_were_trained_as_the_docs_say(first: str, trained: str) -> None:
    method, weights, name, *changes = trained.split()
    card = load_weights(find_weights(method, weights), method)[1]
    # All were trained on a processor with bf16, which `auto` takes there.
    chosen = values_of(changes, "--set")
    documented = read_configuration(name, {**chosen, "precision": "bf16"})
    assert TrainingConfiguration.model_validate(card.configuration) == documented
    assert card.started_from.startswith(first)


def test_every_shipped_configuration_can_be_read() -> None:
    read = {name: read_configuration(name) for name in shipped_configurations()}
    for found in read.values():
        found.architecture("dfd-net")
    # These suit any processor.
    assert {read[name].precision for name in ("demo", "demo-fine", "demo-u-net")} == {"auto"}
    changes = {"steps": 14000, "evaluate_every": 3500, "readout": "median"}
    changed = read["demo-fine"].model_copy(update={"tracks": tuple(OF_PATCHES), **changes})
    assert read["robust"] == changed
    assert read["published-realworld"] == read["published"].model_copy(update={"patience": 3000})


def test_what_is_no_configuration(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="demo, published"):
        read_configuration("publisht")
    path = tmp_path / "mine.toml"
    path.write_text("crop = = 3")
    with pytest.raises(InputError, match="not a TOML file"):
        read_configuration(str(path))
    path.write_text('crop = 3\nnoice = 1\nprecision = "int8"\nlearning_rate = -1\n')
    with pytest.raises(InputError) as caught:
        read_configuration(str(path))
    assert len(caught.value.problems) == 4
    for word in ("crop", "noice", "precision", "learning_rate", "mine.toml"):
        assert word in str(caught.value)
    # A switch is no number.
    for name in ("steps", "crop", "noise", "filters", "sampling_size"):
        with pytest.raises(InputError, match=f"{name}(.|\\n)*not true or false"):
            read_configuration("published", {name: True})
    for said, changes in (
        ("needs steps", {"schedule": "cosine"}),
        ("F-02-02", {"filters": "F-99"}),
        ("whose depth is redrawn", {"recipe": "text"}),
        (r"any of noise, psf.*got nois", {"tracks": ["nois"]}),
    ):
        with pytest.raises(InputError, match=said):
            read_configuration("published", changes)


def test_a_processor_trains_in_what_it_does_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    cpu = torch.device("cpu")
    for known, precision, said in (
        ({"amx_bf16": True, "avx512_bf16": True}, "bf16", "amx_bf16"),
        ({"avx512_bf16": True, "amx_bf16": False}, "bf16", "avx512_bf16"),
        ({"avx512_f": True, "avx2": True}, "float32", "no fast bf16"),
    ):
        monkeypatch.setattr(torch.cpu, "get_capabilities", known.copy)
        found, reason = precision_for(cpu)
        assert found == precision
        assert said in reason
        assert settled(TrainingConfiguration(precision="auto"), cpu).precision == precision
        assert settled(TrainingConfiguration(precision="float32"), cpu).precision == "float32"
