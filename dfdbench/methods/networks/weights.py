"""A network's weights in one file, with a model card that says where they come from."""

import hashlib
import re
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

import safetensors
import safetensors.torch
import torch
from pydantic import Field, ValidationError
from torch import Tensor, nn

from dfdbench.errors import MethodError, Problem, reason_of
from dfdbench.methods.networks.architectures import DfDNet, UNet
from dfdbench.methods.networks.stack import StackNet
from dfdbench.methods.networks.volume import VolumeNet
from dfdbench.system.files import require_file, write_whole
from dfdbench.system.strict import Record, problems_of
from dfdbench.system.text import TRAININGS
from dfdbench.tables.render import escape_markdown

NETWORKS: dict[str, type[nn.Module]] = {
    "dfd-net": DfDNet,
    "stack-net": StackNet,
    "u-net": UNet,
    "volume-net": VolumeNet,
}
_VARIANCE = "running_var"
_METADATA = "dfdbench-card"
# `_BEFORE` separates the trainings in `Card.started_from`, the last first; `_STEPS` ends each name.
_BEFORE = "; that from "
_STEPS = re.compile(r", [\d,]+ steps")
#: What invalid arguments of a network raise.
_UNBUILDABLE = (ArithmeticError, LookupError, RuntimeError, TypeError, ValueError)
_SUFFIX = ".safetensors"
_AGAIN = "name the weights.safetensors of a training, or copy it again if it is one"
_OTHER_VERSION = "train again with this version, or use the version that wrote it"


class Card(Record):
    """Where weights come from: the model card, kept in the file itself.

    `architecture` are the network's constructor arguments, `scores` the means over `scored_on`
    under the protocol ``thesis``, `further_scores` those under others, by their labels; `seconds`
    is the time spent training; `started_from` names the weights that training began with, empty
    for random ones.
    """

    schema_version: Literal[1] = 1
    method: Literal["dfd-net", "stack-net", "u-net", "volume-net"]
    architecture: dict[str, Any]
    parameters: Annotated[int, Field(ge=1)]
    trained_on: str
    started_from: str = ""
    dataset: str
    fingerprint: str
    recipe: str
    configuration: dict[str, Any]
    seed: int
    steps: Annotated[int, Field(ge=0)]
    seconds: Annotated[float, Field(ge=0)]
    ended_by: str
    scored_on: str
    scores: dict[str, float]
    further_scores: dict[str, dict[str, float]] = Field(default_factory=dict)
    environment: dict[str, str]

    @property
    def saw(self) -> str:
        """What it was trained on, and then what its initial weights were, the last first."""
        before = filter(None, self.started_from.split(_BEFORE))
        return TRAININGS.join(
            dict.fromkeys([self.trained_on, *(_STEPS.split(each)[0] for each in before)])
        )

    def scores_under(self, protocol: str) -> dict[str, float]:
        """Return the scores under a protocol, by its label; empty if it was not scored under it."""
        return self.scores if protocol == "thesis" else self.further_scores.get(protocol, {})


def build_network(method: str, architecture: dict[str, Any]) -> nn.Module:
    """Return a network with fresh weights.

    Examples
    --------
    >>> type(build_network("u-net", {"filters": [2, 4, 8, 16, 32]})).__name__
    'UNet'
    """
    return NETWORKS[method](**architecture)


def count_parameters(network: nn.Module) -> int:
    """Return the number of learned parameters."""
    return sum(parameter.numel() for parameter in network.parameters())


def described(path: Path, card: Card) -> str:
    """Return the `Card.started_from` of a training that begins with these weights."""
    earlier = f"{_BEFORE}{card.started_from}" if card.started_from else ""
    steps = f"{card.steps:,} steps in {card.seconds / 60:.1f} minutes"
    return f"{card.trained_on}, {steps}, SHA-256 {weights_sha256(path)[:16]}{earlier}"


def save_weights(path: Path, network: nn.Module, card: Card) -> None:
    """Write weights and card to a safetensors file, and a readable card beside it."""
    tensors = {name: tensor.cpu().contiguous() for name, tensor in network.state_dict().items()}
    content = safetensors.torch.save(tensors, metadata={_METADATA: card.model_dump_json()})
    write_whole(path, content)
    write_whole(path.with_suffix(".md"), card_as_markdown(card))


def shipped_weights() -> dict[str, Path]:
    """Return the weight files that come with the package, by name."""
    folder = Path(str(files("dfdbench.methods.networks.pretrained")))
    return {path.stem: path for path in sorted(folder.glob(f"*{_SUFFIX}"))}


def find_weights(method: str, weights: str | Path | None) -> Path:
    """Return the file of weights given as a path or as the name of shipped weights.

    Raises
    ------
    MethodError
        If there is none; it says how to get one.
    """
    shipped = {
        name.removesuffix(f"-{method}"): path
        for name, path in shipped_weights().items()
        if name.endswith(f"-{method}")
    }
    # Who names some knows how: --weights of some commands, --param of others.
    how = f" (--param weights={next(iter(shipped), 'FILE')})" if weights is None else ""
    known = ", ".join(shipped) or "none"
    fix = f"shipped weights: {known}{how}; dfdbench train {method} makes others"
    if weights is None:
        raise MethodError(f"{method} needs weights", where="parameter weights", fix=fix)
    where, got = str(weights), "nothing of that name"
    if not isinstance(weights, str | Path):
        where, got = "parameter weights", str(weights)
    elif where in shipped:
        return shipped[where]
    elif Path(weights).is_file():
        return Path(weights)
    elif Path(weights).exists():
        got = "something that is no regular file"
    raise MethodError("no such weights", where=where, expected="a file", got=got, fix=fix)


def open_weights(method: str, weights: str | Path | None) -> tuple[nn.Module, Card, str]:
    """Find and load a network; return it with its card and the SHA-256 of its file.

    Raises
    ------
    MethodError
        As for `find_weights` and `load_weights`.
    """
    path = find_weights(method, weights)
    return *load_weights(path, method), weights_sha256(path)


def load_weights(path: Path, method: str) -> tuple[nn.Module, Card]:
    """Load the network in a file, in evaluation mode, and its card.

    Raises
    ------
    MethodError
        If the file is damaged, is not one of ours, or holds another architecture.
    """
    tensors, text = _read_tensors(path)
    card = _read_card(text, path)
    if card.method != method:
        what = f"weights of another architecture, {card.method} instead of {method}"
        raise MethodError(what, where=str(path))
    try:
        # Allocate no memory, since a card may claim any size.
        with torch.device("meta"):
            outline = build_network(method, card.architecture)
    except _UNBUILDABLE as error:
        why = str(error).partition("\n")[0][:200]
        what = f"the model card's architecture cannot be built: {why}"
        raise MethodError(what, where=str(path), fix=_OTHER_VERSION) from error
    _check_tensors(outline, tensors, path)
    network = build_network(method, card.architecture)
    network.load_state_dict(tensors)
    return network.eval(), card


def weights_sha256(path: Path) -> str:
    """Return the SHA-256 of a file of weights."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _read_tensors(path: Path) -> tuple[dict[str, torch.Tensor], str]:
    try:
        require_file(path)
        with safetensors.safe_open(path, framework="pt") as file:
            text = (file.metadata() or {}).get(_METADATA)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (safetensors.SafetensorError, OSError) as error:
        what = f"the weights cannot be read: {reason_of(error)}"
        raise MethodError(what, where=str(path), fix=_AGAIN) from error
    if text is None:
        what = "the weights have no model card"
        raise MethodError(what, where=str(path), fix="name a file that dfdbench train wrote")
    return tensors, text


def _read_card(text: str, path: Path) -> Card:
    try:
        return Card.model_validate_json(text)
    except ValidationError as error:
        what = "the model card cannot be read"
        raise MethodError.of(problems_of(error, what, file=path, fix=_OTHER_VERSION)) from error


def _check_tensors(network: nn.Module, tensors: dict[str, Tensor], path: Path) -> None:
    expected = {name: _outline(tensor) for name, tensor in network.state_dict().items()}
    found = {name: _outline(tensor) for name, tensor in tensors.items()}
    if expected != found:
        names = sorted(expected.keys() | found.keys())
        differ = [name for name in names if expected.get(name) != found.get(name)]
        raise MethodError.of(
            Problem(
                "weights do not fit the architecture of their card", where=f"{path}: {name}",
                expected=expected.get(name, "nothing"), got=found.get(name, "nothing"),
            )
            for name in differ[:5]
        )  # fmt: skip
    broken = sorted(name for name, tensor in tensors.items() if not bool(tensor.isfinite().all()))
    variances = [name for name in tensors if name.endswith(_VARIANCE)]
    negative = [name for name in variances if bool((tensors[name] < 0).any())]
    if negative:
        where = f"{path}: {negative[0]}"
        raise MethodError("the weights hold a variance below 0", where=where, fix=_AGAIN)
    if broken:
        what = f"the weights hold nan or infinity in {', '.join(broken[:3])}"
        raise MethodError(what, where=str(path), fix="train again, with a lower learning_rate")


def _outline(tensor: Tensor) -> str:
    return f"{tuple(tensor.shape)} {str(tensor.dtype).removeprefix('torch.')}"


def card_as_markdown(card: Card) -> str:
    """Return the card as a page for people."""
    rows = {
        "method": card.method,
        "architecture": _as_text(card.architecture),
        "parameters": f"{card.parameters:,}",
        "trained on": escape_markdown(card.trained_on),
        "started from": escape_markdown(card.started_from) or "random weights",
        "data set": ", fingerprint ".join(filter(None, (card.dataset, card.fingerprint))),
        "recipe": card.recipe or "none: captured defocus",
        "seed": str(card.seed),
        "steps": f"{card.steps:,}, ended by {card.ended_by}",
        "time": f"{card.seconds / 60:.1f} minutes",
        "machine": ", ".join(f"{name} {value}" for name, value in card.environment.items()),
        "configuration": _as_text(card.configuration),
        f"scores on {card.scored_on}": _scores_as_text(card.scores) or "–",
    } | {
        f"under the protocol `{protocol}`": _scores_as_text(scores)
        for protocol, scores in card.further_scores.items()
    }
    lines = [f"| {name} | {value} |" for name, value in rows.items()]
    others = " where no other is named" if card.further_scores else ""
    head = f"# {card.method}, {escape_markdown(card.trained_on)}\n\n| | |\n|:---|:---|"
    note = (
        f"Scores are means over pairs under the protocol `thesis`{others}. Written by "
        "`dfdbench train`."
    )
    return "\n".join([head, *lines, f"\n{note}\n"])


def _scores_as_text(scores: dict[str, float]) -> str:
    return ", ".join(f"{name.upper()} {value:.4f}" for name, value in scores.items())


def _as_text(values: dict[str, Any]) -> str:
    return "; ".join(
        f"{name} {' '.join(map(str, value)) if isinstance(value, (list, tuple)) else value}"
        for name, value in values.items()
    )
