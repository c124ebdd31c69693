"""Try a method on synthetic images, to find mistakes before a long run or to compile its code."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.blur.formation import focus_levels, form_pair, form_stack
from dfdbench.blur.recipe import LAST_LEVEL, RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.blur.tracks import TRACKS, Degradation
from dfdbench.datasets.captures import PAIR, Capture, ImageFacts, Role
from dfdbench.datasets.depth_scale import DepthScale, Rig
from dfdbench.datasets.manifest import Depth, Pair
from dfdbench.errors import DfdbenchError
from dfdbench.methods.calling import FEW_LEVELS, TorchMethod, call, difference, in_few_levels
from dfdbench.methods.fitted import Solver
from dfdbench.methods.method import Image, Learned, Method, Prediction, restore, teach
from dfdbench.methods.process_state import seeded
from dfdbench.methods.registry import Facts, built_in_methods, load_method
from dfdbench.methods.rims import settle_rims
from dfdbench.metrics.protocol import Unit, protocols_of, score
from dfdbench.metrics.scores import AGAINST, correlation
from dfdbench.system.parallel import Processes, one_by_one

#: The seed of the images, and of each call, as in a run.
_SEED = 0
_RECIPE = RECIPES["published"]
_ORDINARY = "an ordinary pair, 240 × 320"
_SCALE = DepthScale(near=0.5, far=5.0, far_level=0)
#: The number of focus planes that a method of stacks is tried on.
_PLANES = 4
_BLURLESS = "a pair without blur"
_FIT = "fit, on two made pairs"
_AGAIN = "the same pair again"
_ELSEWHERE = "the same pair in another process"
_SEEDED = "an answer may depend only on the pair and the run's seed"


def load_to_check(name: str, parameters: Mapping[str, Any]) -> Method:
    """Load a method with the facts of an invented data set, to check it before a run.

    A class with a fit gets no recipe: it has to measure the blur, which tries its fit.

    Raises
    ------
    MethodError, UnknownNameError
        As for `dfdbench.methods.load`.
    """
    offers: Facts = {
        "recipe": lambda: _RECIPE,
        "recipe_name": lambda: "published",
        "training_mean": lambda: 128.0,
        "training_median": lambda: 128.0,
        "seed": lambda: 0,
        "rig": Rig,
    }
    return load_method(name, parameters, offers, {"recipe": lambda: None})


def made_pair(
    infocus: Image,
    defocus: Image,
    levels: Image,
    valid: NDArray[np.bool_],
    planes: int = 0,
    unit: Unit = "levels",
) -> Capture:
    """Return a synthetic pair as a capture, or, with `planes`, a stack.

    The stack is the in-focus image and `planes` others, focused at levels that are evenly spaced
    in 1 / distance from 5 m to 0.5 m.
    """
    about = Depth(axes=[], unknown=0, grows_with="nearness", unit=unit, scale=_SCALE)
    images, facts, depth = [infocus, defocus], ImageFacts(), levels.astype(np.float64)
    if planes:
        images = [infocus, *form_stack(infocus, levels, _RECIPE, planes)]
        focus = np.array([np.nan, *focus_levels(planes)])
        distance = _SCALE.to_metres(focus)
        roles: tuple[Role, ...] = (PAIR[0], *(PAIR[1] for _ in range(planes)))
        facts = ImageFacts(roles, distance, distance if unit == "metres" else focus)
    if unit == "metres":
        depth = _SCALE.to_metres(levels)
    known = np.where(valid, depth, np.nan).astype(np.float32)
    return Capture(Pair("made", ()), np.stack(images), known, facts, about)


@dataclass(frozen=True)
class Check:
    """One input that was tried, with its error and warning, which are empty if there is none."""

    name: str
    seconds: float
    error: str = ""
    warning: str = ""


def check_method(
    method: Method,
    load: Callable[[], Method] | None = None,
    on_trial: Callable[[str], None] | None = None,
) -> tuple[Check, ...]:
    """Call a method on awkward pairs and say what is wrong with its answers.

    It tries odd sizes, tall and wide images, a flat, a black and a saturated pair, and a pair
    without blur. It calls the same pair again, here and in another process, as `run --workers`
    would (the answers must be equal). It checks whether the method writes into its images, whether
    its levels go from 0 to 255 rather than from 0 to 1, and whether its depth is brighter for
    nearer, which shows on a slope whose near side is less blurred. A method with a fit is fitted
    to two synthetic pairs first; if that fails, nothing else is tried. A method of stacks gets
    stacks of the in-focus image and four focus planes.

    Parameters
    ----------
    method : Method
        The method to check.
    load : callable, optional
        Loads the method anew in another process, so it has to be picklable. Without it the method
        is not tried in another process.
    on_trial : callable, optional
        Called with the name of each input before it is tried.
    """
    here = ""

    def at(name: str) -> None:
        nonlocal here
        here = name
        if on_trial:
            on_trial(name)

    try:
        return _tried(method, load, at)
    except KeyboardInterrupt as stopped:
        stopped.add_note(f"it was at {here}")
        raise


def _tried(
    method: Method, load: Callable[[], Method] | None, at: Callable[[str], None]
) -> tuple[Check, ...]:
    pairs = _awkward_pairs(method)
    ordinary = pairs[_ORDINARY]
    trials = []
    learned: Learned | None = None
    if method.learner is not None:
        at(_FIT)
        trial, learned = _try_fit(method)
        trials.append(trial)
        if trial.error:
            return tuple(trials)
    if isinstance(method.predict, TorchMethod):
        trials.append(Check("a torch module: run with eval() and no_grad()", 0))
    if method.warm_up:
        at("its warm_up")
        call(method.warm_up, *method.called_on(ordinary)[1])
    answers = {}
    for name, images in pairs.items():
        at(name)
        answers[name] = prediction = _answer(method, images)
        trials.append(Check(name, prediction.seconds, prediction.error, _odd(prediction)))
    first = answers[_ORDINARY]
    if first.depth is not None:
        at(_AGAIN)
        trials.append(_try_again(method, ordinary, first))
        # A method that keeps its fit in itself cannot be sent there; the fit's own line says so.
        if load and not trials[-1].error and (method.learner is None or learned is not None):
            at(_ELSEWHERE)
            trials.append(_try_elsewhere(partial(_answer_anew, load, learned), ordinary, first))
        turned = correlation(ordinary.depth, first.depth) < AGAINST
        if ordinary.about.kind == "levels":
            odd = "depth seems to grow with distance: every set wants brighter for nearer"
            trials.append(Check("brighter for nearer", first.seconds, warning=odd * turned))
            odd = FEW_LEVELS if in_few_levels(first.depth) else ""
            trials.append(Check("levels from 0 to 255", first.seconds, warning=odd))
        else:
            odd = "distances seem to fall where the scene is farther"
            trials.append(Check("farther is more", first.seconds, warning=odd * turned))
    trials.append(_try_writing(method, pairs[_BLURLESS]))
    return tuple(trials)


def _odd(prediction: Prediction) -> str:
    """Return what is odd about an answer but not an error."""
    oddities = ["printed to standard output"] if prediction.printed else []
    if prediction.depth is not None and (gaps := float(np.isnan(prediction.depth).mean())):
        share = f"{100 * gaps:.0f} % of the pixels"
        oddities.append(f"no answer in {share}: ranked by protocol sure alone")
    return "; ".join(oddities)


def _answer(method: Method, pair: Capture) -> Prediction:
    predict, images = method.called_on(pair)
    with seeded(_SEED):
        return call(predict, *images, unit=pair.about.kind)


def _try_again(method: Method, pair: Capture, first: Prediction) -> Check:
    # Twice: a method that remembers its last pair gives its first answer again only then.
    for _ in range(2):
        again = _answer(method, pair)
        if differs := _unlike(first, again):
            return Check(_AGAIN, again.seconds, f"{differs}: {_SEEDED}")
    return Check(_AGAIN, again.seconds)


def _answer_anew(
    load: Callable[[], Method], learned: Learned | None, images: Capture
) -> Prediction:
    method = load()
    if learned is not None:
        restore(method, learned)
    return _answer(method, images)


def _try_elsewhere(
    answer: Callable[[Capture], Prediction], pair: Capture, first: Prediction
) -> Check:
    try:
        (there,) = Processes(1).map(answer, [pair])
    except DfdbenchError as raised:
        return Check(_ELSEWHERE, 0, " ".join(str(raised).split()))
    differs = _unlike(first, there)
    error = there.error or (f"{differs}: {_SEEDED}" if differs else "")
    return Check(_ELSEWHERE, there.seconds, error)


def _unlike(one: Prediction, other: Prediction) -> str:
    sigma = difference(one.sigma, other.sigma)
    return difference(one.depth, other.depth) or f"its sigma {sigma}" * bool(sigma)


def _awkward_pairs(method: Method) -> dict[str, Capture]:
    random = np.random.default_rng(_SEED)

    def made(sharp: Image, blurred: Image) -> Capture:
        levels = _slope(*sharp.shape[:2])
        return made_pair(sharp, blurred, levels, levels > 0, *_kind(method))

    def noise(height: int, width: int) -> Capture:
        image = random.integers(0, 256, (height, width, 3)).astype(np.uint8)
        return made(image, synthesize(image, _slope(height, width), _RECIPE))

    def flat(value: int) -> Capture:
        image = np.full((120, 160, 3), value, np.uint8)
        return made(image, image.copy())

    sharp = noise(120, 160).infocus
    return {
        _ORDINARY: noise(240, 320),
        "odd sizes, 121 × 163": noise(121, 163),
        "a tall image, 200 × 60": noise(200, 60),
        "a wide image, 60 × 200": noise(60, 200),
        "a small image, 33 × 47": noise(33, 47),
        "a black pair": flat(0),
        "a flat grey pair": flat(128),
        "a saturated pair": flat(255),
        _BLURLESS: made(sharp, sharp.copy()),
    }


def _kind(method: Method) -> tuple[int, Unit]:
    return (_PLANES if method.takes_stack else 0), method.answers_in("levels")


def _try_fit(method: Method) -> tuple[Check, Learned | None]:
    pairs = []
    for number in range(2):
        random = np.random.default_rng((_SEED, number))
        image = random.integers(0, 256, (144, 192, 3)).astype(np.uint8)
        # Blocks of many levels, so that a fit finds each of them in both pairs.
        blocks = random.permutation(np.linspace(0, 255, 48)).reshape(6, 8).astype(np.uint8)
        depth = np.kron(blocks, np.ones((24, 24), np.uint8))
        blurred = synthesize(image, depth, _RECIPE)
        pairs.append(made_pair(image, blurred, depth, depth > 0, *_kind(method)))
    handed = [array for pair in pairs for array in (pair.images, pair.depth)]
    before = [array.copy() for array in handed]
    try:
        learned, seconds = teach(method, pairs, _SEED)
    except DfdbenchError as error:
        return Check(_FIT, 0, " ".join(str(error).split())), None
    same = partial(np.array_equal, equal_nan=True)
    odd = [] if all(map(same, handed, before)) else ["changes the pairs it is handed"]
    if learned is None:
        odd.append("returns None: it is called again when a run goes on, and not with --workers")
    return Check(_FIT, seconds, warning="; ".join(odd)), learned


def _slope(height: int, width: int) -> Image:
    levels = np.linspace(40, 220, width).astype(np.uint8)
    return np.broadcast_to(levels, (height, width)).copy()


def _try_writing(method: Method, pair: Capture) -> Check:
    # `call` hands out copies, so nothing is spoilt here; but elsewhere such a method is a trap.
    predict, images = method.called_on(pair)
    mine = [image.copy() for image in images]
    odd = []

    def predict_on_mine(*_: object) -> object:
        returned: object = predict(*mine)
        if getattr(returned, "requires_grad", False):
            odd.append("returns a tensor with a gradient: torch.no_grad() would save memory")
        return returned

    prediction = call(predict_on_mine, *images, unit=pair.about.kind)
    if not all(map(np.array_equal, mine, images)):
        odd.append("changes the images it is handed")
    return Check("leaves its input alone", prediction.seconds, prediction.error, "; ".join(odd))


#: The shape of the images to warm up on.
_SHAPE = (24, 40)
#: Entries of mere networks, which numba does not compile, and of a method that needs PyTorch too.
_LEARNED = ("dfdbench.methods.learned:", "dfdbench.methods.stack_net:")
_VOLUME = "dfdbench.methods.volume_net:"


def warm_up(on_step: Callable[[int, int], None] | None = None) -> None:
    """Call everything that is compiled on synthetic images, so that its machine code is cached.

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
            yield partial(_try_all, name)
    yield from (_blur, _score, _render)


def _try_all(name: str) -> None:
    method = load_to_check(name, {})
    check_method(method)
    solver = method.predict
    if isinstance(solver, Solver):
        # A given blur compiles other code than a measured one, and stacks compile more than pairs.
        laws, image = solver.blurs, np.zeros((*_SHAPE, 3), np.uint8)
        if "recipe" in signature(type(solver)).parameters:
            type(solver)(recipe=_RECIPE).warm_up(image, image)
        settle_rims([*laws, *laws], image, [image, image], np.zeros(_SHAPE, np.float32))


def _blur() -> None:
    image = np.random.default_rng(0).integers(0, 256, (*_SHAPE, 3)).astype(np.uint8)
    levels = np.linspace(0, LAST_LEVEL, _SHAPE[1]).astype(np.uint8)
    depth = np.tile(levels, (_SHAPE[0], 1))
    for track in TRACKS.values():
        form_pair(image, depth, _RECIPE, Degradation(track, 3), "a/pair")
    form_stack(image, depth, _RECIPE, 2)


def _score() -> None:
    depth = np.tile(np.arange(_SHAPE[1], dtype=np.float32), (_SHAPE[0], 1))
    for protocol in protocols_of(False, "levels").values():
        score(protocol, depth, np.ones(_SHAPE, bool), depth + 1, _SHAPE[0])


def _render() -> None:
    from dfdbench.simulation.unseen import render_pair, render_stack  # they compile

    render_pair(0, 0, rays=1)
    render_stack(0, 0, planes=1, rays=1)
