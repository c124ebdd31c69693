"""What runs in the process of an isolated method: it is loaded, shown images, and asked.

Only requests come in; only JSON and arrays go out. What the method prints while it is loaded goes
to standard error, for standard output is the way back.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any, overload

import numpy as np
from numpy.typing import NDArray

from dfdbench.errors import DfdbenchError
from dfdbench.methods.calling import call
from dfdbench.methods.fit import Learned, restore, teach
from dfdbench.methods.importing import describe
from dfdbench.methods.isolation import seeded
from dfdbench.methods.method import Method
from dfdbench.methods.registry import load_method
from dfdbench.system.messages import Arrays, receive, send

#: The facts of a data set that a method may ask for.
OFFERS = ("recipe", "recipe_name", "training_mean", "seed", "rig")
_Facts = Mapping[str, Any]


@dataclass(frozen=True)
class ShownPair:
    """What a fit is shown of a training pair, as `dfdbench.methods.fit.TrainingPair`."""

    infocus: NDArray[np.uint8]
    defocus: NDArray[np.uint8]
    depth: NDArray[np.uint8]
    valid: NDArray[np.bool_]


class _Way:
    """The two pipes to the process that asks."""

    def __init__(self, requests: IO[bytes], answers: IO[bytes]) -> None:
        self._requests, self._answers = requests, answers
        self._came: queue.SimpleQueue[tuple[_Facts, Arrays]] = queue.SimpleQueue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        # Beside the method, so that it ends with the process that asks, busy or not.
        try:
            while True:
                self._came.put(receive(self._requests))
        finally:
            _end()

    def next(self) -> tuple[_Facts, Arrays]:
        return self._came.get()

    def answer(self, facts: _Facts, arrays: Mapping[str, Any] | None = None) -> None:
        send(self._answers, facts, arrays or {})

    def ask(self, facts: _Facts) -> Arrays:
        self.answer(facts)
        return self.next()[1]


def _end() -> None:
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        # With it whatever the method has started.
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


class _Pairs(Sequence[ShownPair]):
    """Training pairs, each sent for when a fit asks for it."""

    def __init__(self, way: _Way, places: range) -> None:
        self._way, self._places = way, places

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, index: int) -> ShownPair: ...

    @overload
    def __getitem__(self, index: slice) -> _Pairs: ...

    def __getitem__(self, index: int | slice) -> ShownPair | _Pairs:
        if isinstance(index, slice):
            return _Pairs(self._way, self._places[index])
        return ShownPair(**self._way.ask({"ask": "pair", "index": self._places[index]}))


def main(requests: IO[bytes]) -> None:
    """Load the method that is asked for, and answer until nobody asks any more.

    Parameters
    ----------
    requests : binary file
        Where they come in.
    """
    way = _Way(requests, os.fdopen(os.dup(1), "wb"))
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    try:
        _serve(way)
    except BaseException as error:
        # The keyboard does not reach this process: it is the method that raised it, or that left
        # nothing whole to answer with.
        _tell_and_end(error)


def _tell_and_end(error: BaseException) -> None:
    try:
        text = f"the method broke its process: {describe(error)}\n"
        os.write(2, text.encode("utf-8", "replace"))
    finally:
        os._exit(1)


def _serve(way: _Way) -> None:
    facts, arrays = way.next()
    seed = int(facts["seed"])
    try:
        method = _loaded(way, pickle.loads(arrays["order"].tobytes()))
        says = _says(method)
    except DfdbenchError as error:
        way.answer({"problems": _told(error)})
        return
    loaded = {
        "entry": method.entry,
        "parameters": method.parameters,
        "uses": method.uses,
        "source_sha256": method.source_sha256,
        "fits": method.fit is not None,
        "warms_up": method.warm_up is not None,
    }
    way.answer({"loaded": loaded, "says": says})
    doing: dict[str, Callable[[_Facts, Arrays], None]] = {
        "predict": lambda _, images: _predict(way, method, method.predict, images, seed),
        "warm_up": lambda _, images: _predict(way, method, method.warm_up, images, seed),
        "fit": lambda facts, _: _fit(way, method, int(facts["count"]), seed),
        "restore": lambda _, learned: _restore(way, method, learned),
    }
    while True:
        facts, arrays = way.next()
        doing[facts["do"]](facts, arrays)


def _loaded(way: _Way, order: _Facts) -> Method:
    def offer(ask: str, name: str) -> Callable[[], Any]:
        return lambda: pickle.loads(way.ask({"ask": ask, "name": name})["fact"].tobytes())

    offers = {name: offer("offer", name) for name in OFFERS}
    for_fits = {"recipe": offer("offer for fits", "recipe")}
    return load_method(order["name"], order["parameters"], offers, for_fits)


def _says(method: Method) -> dict[str, Any]:
    return {
        "trained_on": method.trained_on,
        "paper": method.paper,
        "weights_sha256": method.weights_sha256,
        "warnings": method.warnings,
    }


def _predict(way: _Way, method: Method, predict: Any, images: Arrays, seed: int) -> None:
    with seeded(seed):
        prediction = call(predict, images["infocus"], images["defocus"])
    told = {
        "error": prediction.error,
        "printed": prediction.printed,
        "numbers": prediction.numbers,
        "says": _says(method),
    }
    way.answer(told, {} if prediction.depth is None else {"depth": prediction.depth})


def _fit(way: _Way, method: Method, count: int, seed: int) -> None:
    try:
        learned = teach(method, _Pairs(way, range(count)), seed).learned
        says = _says(method)
    except DfdbenchError as error:
        way.answer({"problems": _told(error)})
    else:
        way.answer({"kept": learned is None, "says": says}, learned)


def _restore(way: _Way, method: Method, arrays: Arrays) -> None:
    learned: Learned = {
        name: array if array.ndim else array.item() for name, array in arrays.items()
    }
    try:
        restore(method, learned)
        says = _says(method)
    except DfdbenchError as error:
        way.answer({"problems": _told(error)})
    else:
        way.answer({"says": says})


def _told(error: DfdbenchError) -> list[dict[str, str]]:
    names = ("what", "where", "expected", "got", "fix")
    return [{name: getattr(problem, name) for name in names} for problem in error.problems]
