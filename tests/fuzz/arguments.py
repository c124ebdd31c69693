"""Command lines out of the command line's own tree of verbs: a new verb is tried unlisted."""

import enum
import functools
import typing
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

from typer.main import get_command

from dfdbench.cli import app

_STRANGE = (
    *("", " ", ".", "nosuch", "no/such/file", "x" * 300, "a/" * 1500, "\udcff", "\x1b[31m", "é"),
    *("日本", "-1", "0", "1", "1e308", "nan", "inf", "-inf", "9" * 30, "9" * 5000, "--", "-", "@"),
    *("demo@", "demo@noise-1@x", "demo@noise-9", "realworld@noise-1", "[", "{", "[" * 3000, '"'),
    *("1:2", "8:512", "512:8", "1,2", "k00-k99999999", "0-1000000000", "1000000000-0", "1h", "0s"),
    *("99999h", "s3://", "s3://a/b", "file:///", "memory://x/y.zarr", "http://[", "nosuch://x"),
    *("http://nosuch.invalid/x", "~", "$HOME", "%s", "*", "a=b", "=", "a=", "a=[", "mine.py:"),
    *(":predict", "nosuch:thing", "mine.py:nan", "../up", "/dev/null", "out.png", "mine"),
    *("mine.py", "site", "board", "lens.csv", "quick.toml", "all", "train", "One", "K1", "thesis"),
    *("valid", "run", "tiny.zarr"),
)
# By an option's name; what is not here takes a sound value of its type.
_SOUND = {
    "dataset": ("tiny.zarr", "tiny.zarr", "demo"),
    "name": ("tiny.zarr", "middlebury", "tiny-1.toml", "noise", "mine"),
    "test_dataset": ("tiny.zarr",),
    "method": ("constant", "local", "mine.py:predict", "mine.py:raises", "mine.py:Fitted"),
    "result": ("run", "run/result.json", "fitted"),
    "results": ("run", "other", "board/results/demo-1-test/mine.json"), "first": ("run",),
    "second": ("other",), "source": ("site", "mine"), "folder": ("board", "mine"),
    "predictions": ("maps",), "split": ("train", "test", "all", "K1", "Two"),
    "fold": ("K1", "One"), "train": ("train",), "test": ("test",),
    "protocol": ("thesis", "valid"), "config": ("quick.toml",),
    "weights": ("weights.safetensors", "demo"),
    "param": ("window=5", "level=3", "recipe=told.toml", "recipe=law.toml"),
    "changes": ("noise=1", "steps=2", "crop=12"), "bounds": ("width=8:128",), "max_time": ("1s",),
    "lens": ("lens.csv",), "rows": ("training",), "scene": ("all", "k01"), "scenes": ("k00",),
    "steps": ("129,141",), "exposures": ("40",), "pair": ("141,129",), "focal_length": ("9.6mm",),
    "focus": ("0.5m",), "pixel": ("4.8um",), "baseline": ("0.1m",), "range": (("1.5", "2.2"),),
    "metric": ("nrmse",), "names": ("stores", "downloads", "demo"), "out": ("out", "out.png"),
    "png": ("png",), "figure": ("figure.png",), "cache": ("cache",),
    "mirror": ("http://nosuch.invalid/x",), "device": ("cpu", "auto"), "pairs": ("test", "1"),
    "turn": ("0,0,0",), "values": ("1", "1,2"), "store": ("out.zarr", "tiny.zarr"),
    "unit": ("levels",), "trust": ("mine:predict",),
}  # fmt: skip
# Never from the pool: they would start processes, or ask a cluster that is not there.
_ALONE = {"workers": ("1", "0", "-1", "x", ""), "scheduler": ("", "nonsense", "nosuch://x", "tcp:")}
# The last of an option that is given twice holds: work that takes long by design is kept short.
_SHORT = {
    "train": "--config quick.toml --max-time 1s --device cpu --threads 1",
    "thesis experiment": "--config quick.toml --max-time 1s --repeats 1 --device cpu --threads 1",
    "thesis search architecture": "--config quick.toml --max-time 1s --particles 1 "
    "--iterations 0 --device cpu --threads 1",
    "run": "--limit 2",
    "tracks": "--track noise --dataset tiny.zarr",
    "rig simulate realworld": "--scenes nosuch",
    "build": "--offline",
    "audit split": "--test-scenes 1",
}
# A verb that computes for long whatever it is asked.
_LEFT_OUT = {"rig simulate lens", "thesis reduce"}


@functools.cache
def verbs() -> dict[str, Any]:
    """Return every verb by its words, as the command line itself has them."""
    return dict(_walk(get_command(app), ()))


def _walk(command: Any, path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    below = command.list_commands(None) if hasattr(command, "commands") else ()
    for name in below:
        yield from _walk(command.get_command(None, name), (*path, name))
    if path:
        yield " ".join(path), command


def command_line(random: Random) -> tuple[str, ...]:
    """Return a command line: a verb, options that it has and some that it has not."""
    known = verbs()
    verb = random.choice([name for name in known if name not in _LEFT_OUT])
    words = []
    for parameter in known[verb].params:
        wanted = parameter.required and random.random() < 0.95
        if wanted or random.random() < 0.25:
            for _ in range(random.choice((1, 1, 2)) if parameter.multiple else 1):
                words += _words(parameter, random)
    if random.random() < 0.1:
        words.insert(random.randrange(len(words) + 1), random.choice((*_STRANGE, "--nosuch", "-x")))
    short = _SHORT.get(verb, "")
    return (*verb.split(), *words, *short.split())


def _words(parameter: Any, random: Random) -> list[str]:
    values = _values(parameter, random)
    if parameter.param_type_name == "argument":
        return values
    option = random.choice([*parameter.opts, *parameter.secondary_opts])
    return [option] if getattr(parameter, "is_flag", False) else [option, *values]


def _values(parameter: Any, random: Random) -> list[str]:
    count = max(parameter.nargs, 1)
    if parameter.name in _ALONE:
        return [random.choice(_ALONE[parameter.name])]
    if random.random() < 0.35:
        return [random.choice(_STRANGE) for _ in range(count)]
    if parameter.name in _SOUND:
        chosen: Any = random.choice(_SOUND[parameter.name])
        return [chosen] if isinstance(chosen, str) else list(chosen)
    return [random.choice(of_type(parameter.type_descriptor.annotation)) for _ in range(count)]


def of_type(annotation: Any) -> tuple[str, ...]:
    """Return the values that an option of a type takes, or some of them."""
    if isinstance(annotation, type) and issubclass(annotation, enum.Enum):
        return tuple(str(each.value) for each in annotation)
    if typing.get_origin(annotation) is typing.Literal:
        return typing.get_args(annotation)
    if annotation in (int, float):
        return ("1", "2", "3") if annotation is int else ("0.5", "1", "2")
    return ("out",) if annotation is Path else ("all",)
