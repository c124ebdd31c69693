from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import safetensors.torch
import torch
from torch import nn

from dfdbench.errors import MethodError
from dfdbench.methods.networks import weights as files
from dfdbench.methods.registry import load
from tests.methods.made_weights import card
from tests.methods.networks.test_architectures import SMALL


@pytest.fixture
def network() -> nn.Module:
    return files.build_network("dfd-net", {"filters": list(SMALL)})


def test_weights_come_back_with_their_card_and_are_the_same_bytes_again(
    weights: Path, tmp_path: Path
) -> None:
    network, found = files.load_weights(weights, "dfd-net")
    assert found == card()
    assert not network.training
    torch.manual_seed(2)
    fresh = files.build_network("dfd-net", {"filters": list(SMALL)}).state_dict()
    assert all(torch.equal(fresh[name], value) for name, value in network.state_dict().items())
    page = weights.with_suffix(".md").read_text()
    assert "| trained on | tiny-1, split train |" in page
    assert "NRMSE 0.2500" in page
    # The same weights are the same bytes.
    files.save_weights(tmp_path / "again.safetensors", network, found)
    assert (tmp_path / "again.safetensors").read_bytes() == weights.read_bytes()


def test_a_card_shows_others_text_as_it_is() -> None:
    theirs = "a | b\n<b>"
    told = card().model_copy(update={"trained_on": theirs, "started_from": theirs})
    page = files.card_as_markdown(told)
    assert page.count("a \\| b &lt;b&gt;") == 3
    assert "<b>" not in page


def test_weights_that_cannot_be_used_say_why(weights: Path, tmp_path: Path) -> None:
    content = weights.read_bytes()
    for cut in (0, 5, len(content) // 2, len(content) - 1):
        (tmp_path / "cut.safetensors").write_bytes(content[:cut])
        with pytest.raises(MethodError, match="the weights cannot be read"):
            files.load_weights(tmp_path / "cut.safetensors", "dfd-net")
    with pytest.raises(MethodError, match="another architecture, dfd-net instead of u-net"):
        files.load_weights(weights, "u-net")
    foreign = tmp_path / "foreign.safetensors"
    safetensors.torch.save_file({"a": torch.zeros(2)}, foreign)
    with pytest.raises(MethodError, match="no model card"):
        files.load_weights(foreign, "dfd-net")
    safetensors.torch.save_file({"a": torch.zeros(2)}, foreign, {"dfdbench-card": '{"seed": "x"}'})
    with pytest.raises(MethodError, match="the model card cannot be read") as caught:
        files.load_weights(foreign, "dfd-net")
    assert len(caught.value.problems) > 5


def test_numbers_that_are_none_are_refused(tmp_path: Path, network: nn.Module) -> None:
    path = tmp_path / "nan.safetensors"
    with torch.no_grad():
        next(network.parameters()).fill_(float("nan"))
    files.save_weights(path, network, card())
    with pytest.raises(MethodError, match="nan or infinity in"):
        files.load_weights(path, "dfd-net")
    with pytest.raises(MethodError, match="no such weights"):
        load("dfd-net", weights=5)


def test_tensors_of_another_kind_are_refused(tmp_path: Path, network: nn.Module) -> None:
    path = tmp_path / "odd.safetensors"
    files.save_weights(path, network, card())
    tensors = safetensors.torch.load_file(path)
    with safetensors.safe_open(path, "pt") as file:
        metadata = file.metadata()
    name = next(name for name in tensors if name.endswith("weight"))
    odd = {**tensors, name: tensors[name].view(torch.int32)}
    safetensors.torch.save_file(odd, path, metadata)
    with pytest.raises(MethodError, match="do not fit the architecture") as told:
        files.load_weights(path, "dfd-net")
    assert told.value.problems[0].got.endswith("int32")
    name = next(name for name in tensors if name.endswith("running_var"))
    safetensors.torch.save_file({**tensors, name: -tensors[name]}, path, metadata)
    with pytest.raises(MethodError, match="a variance below 0"):
        files.load_weights(path, "dfd-net")


def test_an_architecture_that_cannot_be_built_is_told(tmp_path: Path, network: nn.Module) -> None:
    # As large as the second claims to be it would fit in no memory.
    for filters in ([*SMALL[:-1], "nan"], [2**40] * (len(SMALL) - 1) + [256], None):
        architecture = {"bogus": 1} if filters is None else {"filters": filters}
        path = tmp_path / "bogus.safetensors"
        files.save_weights(path, network, card(architecture=architecture))
        with pytest.raises(MethodError, match="architecture cannot be built"):
            files.load_weights(path, "dfd-net")


def test_no_weights_says_how_to_come_by_some(tmp_path: Path) -> None:
    with pytest.raises(MethodError, match="dfdbench train dfd-net") as caught:
        load("dfd-net")
    assert "--param weights=demo" in str(caught.value)
    with pytest.raises(MethodError, match="nothing of that name") as caught:
        load("u-net", weights=str(tmp_path / "nowhere.safetensors"))
    # The command may be `train`, which has no --param.
    assert "shipped weights: demo, middlebury, robust; dfdbench" in str(caught.value)
    with pytest.raises(MethodError, match="no regular file"):
        load("u-net", weights=str(tmp_path))


def test_weights_say_what_those_saw_that_they_began_with() -> None:
    card = files.load_weights(files.find_weights("dfd-net", "robust"), "dfd-net")[1]
    tracks = "split train, random tracks"
    assert card.saw == f"unseen-0-1, {tracks}; demo-1, {tracks}; demo-1, split train"


#: What weights were trained on, by the first words of their name.
TRAINED_ON = {
    "demo": "demo-1, split train",
    "dfd-indoor": "dfd-indoor-1, split train",
    "middlebury": "middlebury-default-1, split train",
    "robust": "-1, split train, random tracks",
    "unseen": "rooms of unseen-0 from 1000 on",
}


def test_shipped_weights_are_small_and_say_what_they_are() -> None:
    shipped = files.shipped_weights()
    assert len(shipped) == 9
    for stem, path in shipped.items():
        name = next(name for name in TRAINED_ON if stem.startswith(name))
        method = stem.removeprefix(f"{name}-")
        assert files.find_weights(method, name) == path
        assert path.stat().st_size < 4_000_000
        assert TRAINED_ON[name] in files.load_weights(path, method)[1].trained_on
        assert path.with_suffix(".md").exists()
