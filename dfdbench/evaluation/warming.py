"""Compile all that numba compiles, before anybody waits for it."""

from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec
from inspect import signature

import numpy as np

from dfdbench.blur.formation import form_pair, form_stack
from dfdbench.blur.recipe import LAST_LEVEL, RECIPES
from dfdbench.blur.tracks import TRACKS, Degradation
from dfdbench.evaluation.check import check_method
from dfdbench.evaluation.loading import load_to_check
from dfdbench.methods.fitted import Solver
from dfdbench.methods.registry import built_in_methods
from dfdbench.methods.rims import settle_rims
from dfdbench.metrics.protocol import protocols_of, score
from dfdbench.system.parallel import one_by_one

_SHAPE = (24, 40)
#: Those of networks alone, of which numba compiles nothing, and one that needs PyTorch, too.
_LEARNED = ("dfdbench.methods.learned:", "dfdbench.methods.stack_net:")
_VOLUME = "dfdbench.methods.volume_net:"


def warm_up(on_step: Callable[[int, int], None] | None = None) -> None:
    """Use whatever is compiled on made images, so that its machine code is cached.

    Parameters
    ----------
    on_step : callable, optional
        Called with (steps done, steps in all).
    """
    for step in one_by_one(list(_steps()), on_step):
        step()


def _steps() -> Iterator[Callable[[], object]]:
    for name, entry in built_in_methods().items():
        lacks = entry.startswith(_VOLUME) and find_spec("torch") is None
        if not entry.startswith(_LEARNED) and not lacks:
            yield partial(_check, name)
    yield from (_blur, _score, _render)


def _check(name: str) -> None:
    method = load_to_check(name, {})
    check_method(method)
    solver = method.predict
    if isinstance(solver, Solver):
        # Of a blur that was told other code is compiled than of one that was measured, and of
        # stacks more than of pairs.
        laws, image = solver.blurs, np.zeros((*_SHAPE, 3), np.uint8)
        if "recipe" in signature(type(solver)).parameters:
            type(solver)(recipe=RECIPES["published"]).warm_up(image, image)
        settle_rims([*laws, *laws], image, [image, image], np.zeros(_SHAPE, np.float32))


def _blur() -> None:
    image = np.random.default_rng(0).integers(0, 256, (*_SHAPE, 3)).astype(np.uint8)
    levels = np.linspace(0, LAST_LEVEL, _SHAPE[1]).astype(np.uint8)
    depth, recipe = np.tile(levels, (_SHAPE[0], 1)), RECIPES["published"]
    for track in TRACKS.values():
        form_pair(image, depth, recipe, Degradation(track, 3), "a/pair")
    form_stack(image, depth, recipe, 2)


def _score() -> None:
    depth = np.tile(np.arange(_SHAPE[1], dtype=np.float32), (_SHAPE[0], 1))
    for protocol in protocols_of(False, "levels").values():
        score(protocol, depth, np.ones(_SHAPE, bool), depth + 1, _SHAPE[0])


def _render() -> None:
    from dfdbench.simulation.unseen import render_pair, render_stack  # they compile

    render_pair(0, 0, rays=1)
    render_stack(0, 0, planes=1, rays=1)
