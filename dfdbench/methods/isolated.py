"""A method in a process of its own, which is shown images and nothing else of the data set.

This is the side that asks; `isolated_process.py` answers, `isolated_places.py` tells what it is to
find. `isolation.py` is none of it: it puts back what a method changes of this process.
"""

from __future__ import annotations

import contextlib
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import JsonValue, TypeAdapter, ValidationError

from dfdbench.errors import DfdbenchError, MethodError, Problem
from dfdbench.methods.calling import NoDepthError
from dfdbench.methods.fit import Learned, TrainingPair
from dfdbench.methods.isolated_places import named_paths, places_of, python_path, renamed
from dfdbench.methods.method import Image, Method
from dfdbench.system.child import Child, ChildEndedError, Facts, Serve
from dfdbench.system.messages import Arrays
from dfdbench.system.record import Record

_MAIN = "dfdbench.methods.isolated_process"
#: What a result says where nothing could hide the disk.
DISK_OPEN = "isolated in a process of its own, but nothing here could hide the disk from it"


class _Loaded(Record):
    entry: str
    parameters: dict[str, JsonValue]
    uses: tuple[str, ...]
    source_sha256: str | None
    fits: bool
    warms_up: bool


class _Says(Record):
    trained_on: str | None
    paper: str | None
    weights_sha256: str | None
    warnings: tuple[str, ...]


class _Depth(Record):
    error: str
    printed: str
    numbers: dict[str, float]
    says: _Says


_Problems = TypeAdapter(list[dict[str, str]])


@dataclass(frozen=True)
class Order:
    """What is to be loaded in a process of its own.

    Parameters
    ----------
    name : str
        The method, as for `dfdbench.methods.load`; a file by its whole path.
    parameters : mapping
        What the user set.
    offers, for_fits : mapping of str to callable
        As for `dfdbench.methods.registry.load_method`; called here, where a method asks.
    seed : int
        Set in `random` and `numpy.random` before each call.
    hidden : tuple of Path
        Files and folders that the process is not to see.
    """

    name: str
    parameters: Mapping[str, Any]
    offers: Mapping[str, Callable[[], Any]]
    for_fits: Mapping[str, Callable[[], Any]]
    seed: int
    hidden: tuple[Path, ...]

    def serve(self, asked: Facts) -> tuple[Facts, Mapping[str, Any]]:
        """Return a fact of the data set that the method's constructor asks for."""
        offered = self.for_fits if asked["ask"] == "offer for fits" else self.offers
        # Towards the method only; nothing that comes from it is unpickled.
        return {}, {"fact": _pickled(offered[asked["name"]]())}


def load_isolated(order: Order, hidden: Sequence[Path]) -> Method:
    """Load a method in a process of its own, and return what stands for it here.

    The process has a folder of its own for home, working directory and temporary files, and of
    the environment what Python and threads need. Where Linux has Landlock, it can read nothing
    but the system, Python's libraries, the folder of the method's module and what parameters
    name; of these not what is hidden.

    Parameters
    ----------
    order : Order
        The method.
    hidden : sequence of Path
        Kept in the method as `Method.apart_from`.

    Raises
    ------
    MethodError
        As of `dfdbench.methods.registry.load_method`, and where the process ends.
    """
    whole = {text: str(Path(text).absolute()) for text in named_paths(order.parameters)}
    place, colon, attribute = order.name.rpartition(":")
    if place.endswith(".py"):
        whole[order.name] = f"{Path(place).absolute()}{colon}{attribute}"
    name = whole.get(order.name, order.name)
    sent = replace(order, name=name, parameters=renamed(order.parameters, whole))
    predict = Isolated(sent)
    told = predict.loaded
    given = {value: key for key, value in whole.items()}
    return Method(
        order.name,
        given.get(told.entry, told.entry),
        predict,
        renamed(told.parameters, given),
        told.uses,
        told.source_sha256,
        tuple(hidden),
    )


class Isolated:
    """Stands for a method in another process, where it is called, fitted and warmed up.

    Where that process ends in a call, the call has no depth map, and a new one takes its place:
    loaded, with what the method learned, and warmed up.

    Parameters
    ----------
    order : Order
        What is loaded.
    """

    def __init__(self, order: Order) -> None:
        self._order = order
        self._says: _Says
        self.loaded: _Loaded
        #: Numbers of the last call, as every method's.
        self.numbers: dict[str, float] = {}
        self._again: list[Callable[[], object]] = []
        self._begin()
        self.fit = self._fit if self.loaded.fits else None
        if self.loaded.warms_up:
            self.warm_up = self._warm_up

    @property
    def trained_on(self) -> str | None:
        """As the method says."""
        return self._says.trained_on

    @property
    def paper(self) -> str | None:
        """As the method says."""
        return self._says.paper

    @property
    def weights_sha256(self) -> str | None:
        """As the method says."""
        return self._says.weights_sha256

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the method says, and whether the disk lies open to it."""
        hidden = self._process.disk_hidden
        return self._says.warnings if hidden else (*self._says.warnings, DISK_OPEN)

    def __call__(self, infocus: Image, defocus: Image) -> Any:
        """Return the method's depth levels.

        Raises
        ------
        NoDepthError
            Where it gave none, or its process ended.
        """
        self.numbers = {}
        images = {"infocus": infocus, "defocus": defocus}
        if self._process.ended:
            self._begin_again()
        try:
            told, arrays = self._depth({"do": "predict"}, images)
        except ChildEndedError as ended:
            # Now, while nobody counts the seconds of a pair that failed.
            with contextlib.suppress(NoDepthError):
                self._begin_again()
            raise NoDepthError(str(ended)) from None
        if told.error:
            raise NoDepthError(told.error)
        self.numbers = told.numbers
        return arrays.get("depth")

    def restore(self, learned: Learned) -> None:
        """Give the method what it learned."""
        self._again = [lambda: self.restore(learned)]
        self._do({"do": "restore"}, learned)

    def _fit(self, pairs: Sequence[TrainingPair]) -> Learned | None:
        def serve(asked: Facts) -> tuple[Facts, Mapping[str, Any]]:
            pair = pairs[range(len(pairs))[int(asked["index"])]]
            names = ("infocus", "defocus", "depth", "valid")
            return {}, {name: getattr(pair, name) for name in names}

        self._again = [lambda: self._fit(pairs)]
        told, arrays = self._do({"do": "fit", "count": len(pairs)}, {}, serve)
        if told.get("kept"):
            return None
        return {name: array if array.ndim else array.item() for name, array in arrays.items()}

    def _warm_up(self, infocus: Image, defocus: Image) -> None:
        images = {"infocus": infocus, "defocus": defocus}
        try:
            self._depth({"do": "warm_up"}, images)
        except ChildEndedError:
            self._begin_again()
        else:
            self._again.append(lambda: self._depth({"do": "warm_up"}, images))

    def _begin(self) -> None:
        path = python_path(self._order.name)
        places = places_of(self._order.name, self._order.parameters, path)
        self._process = Child(_MAIN, path, places, self._order.hidden)
        order = {"name": self._order.name, "parameters": self._order.parameters}
        given = {"order": _pickled(order)}
        told, _ = self._do({"seed": self._order.seed}, given, self._order.serve)
        self.loaded = _checked(_Loaded, told.get("loaded"))

    def _begin_again(self) -> None:
        try:
            self._begin()
            steps = self._again
            for step in steps:
                step()
            self._again = steps
        except (DfdbenchError, ChildEndedError) as error:
            raise NoDepthError(f"cannot be loaded again: {error}") from None

    def _depth(self, facts: Facts, images: Arrays) -> tuple[_Depth, Arrays]:
        told, arrays = self._process.exchange(facts, images)
        checked = _checked(_Depth, told)
        self._says = checked.says
        print(checked.printed, end="")
        return checked, arrays

    def _do(
        self, facts: Facts, arrays: Mapping[str, Any], serve: Serve | None = None
    ) -> tuple[Facts, Arrays]:
        """Ask for something whose failure ends the run."""
        try:
            told, got = self._process.exchange(facts, arrays, serve)
            if "problems" in told:
                problems = _Problems.validate_python(told["problems"])
                raise MethodError.of(Problem(**problem) for problem in problems)
            self._says = _checked(_Says, told.get("says"))
        except (ChildEndedError, ValidationError, TypeError) as error:
            raise MethodError(
                "the method's process did not do what it was asked for",
                where=self._order.name,
                expected=f"an answer to: {facts.get('do', 'load')}",
                got=str(error),
            ) from None
        return told, got


def _checked(kind: type[Any], told: Any) -> Any:
    try:
        return kind.model_validate(told)
    except ValidationError as error:
        raise ChildEndedError(f"its process answered nonsense: {error}") from error


def _pickled(value: Any) -> Any:
    return np.frombuffer(pickle.dumps(value), np.uint8)
