"""Evaluate one pair: call the method and score its answer, in this process or another."""

import json
import os
import platform
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from dfdbench.datasets.captures import Capture
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Depth, Manifest, Pair
from dfdbench.errors import MethodError
from dfdbench.evaluation.fitting import Fit, pack, unpack
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.plan import protocols_on
from dfdbench.methods.calling import FEW_LEVELS, call, difference, in_few_levels
from dfdbench.methods.importing import ONNX
from dfdbench.methods.method import Method, Prediction, restore
from dfdbench.methods.process_state import one_at_a_time, seeded
from dfdbench.methods.sources import Hashes, changes
from dfdbench.metrics.protocol import RELEASED, SURE, Protocol, Unit, score
from dfdbench.metrics.regions import region_errors, regions_of
from dfdbench.metrics.scores import AGAINST, correlation
from dfdbench.results.environment import describe_environment, software
from dfdbench.results.record import Environment, PairResult, pair_scores
from dfdbench.results.run_folder import answer_digest
from dfdbench.system.location import is_local
from dfdbench.tables.table import counted, listed

#: How a pair's warning begins if the method printed, if its depth is reversed, and if a second
#: call gave a different answer.
_PRINTED = "printed"
_TURNED = "depth falls where the truth rises"
_DIFFERS = "a second call on the same pair"
#: And if more than this share of its depth is beyond the set's ends.
_BEYOND = (
    "over a tenth of the pixels lie beyond the set's ends, and count as the end: are these metres?"
)
_MOST_BEYOND = 0.1
#: The most pairs that a warning names.
_NAMED = 10


class Evaluated(NamedTuple):
    """The result of a pair, with the files its process had used until then and its environment."""

    record: PairResult
    answer: Prediction
    used: Hashes
    environment: Environment

    def differs_from(self, again: Self) -> str:
        """Return a warning if a second call on the pair gave a different answer, else nothing."""
        one, other = self.answer, again.answer
        differs = difference(one.depth, other.depth) or difference(one.sigma, other.sigma)
        return f"{_DIFFERS} {differs}" if differs else ""


class PairEvaluator:
    """Call a method on one pair after the other, and score each answer.

    Parameters
    ----------
    store : Dataset
        The data set.
    method : Method
        From `load_for`.
    seed : int
        Set in `random` and `numpy.random` before each pair.
    protocols : iterable of Protocol, optional
        The protocols to score under; by default the current ones that the data set allows.
    """

    def __init__(
        self, store: Dataset, method: Method, seed: int, protocols: Iterable[Protocol] | None = None
    ) -> None:
        self._store = store
        self._method = method
        self._seed = seed
        self._protocols = protocols_on(store) if protocols is None else tuple(protocols)
        self._warm = False

    def __call__(self, pair: Pair) -> tuple[PairResult, Prediction]:
        """Return a pair's record, and the answer in the data set's unit."""
        images = self._images(pair)
        unit = self._store.manifest.depth.kind
        predict, arguments = self._method.called_on(images)
        # Seeds and standard output belong to the whole process.
        with one_at_a_time():
            self._warm_up(images)
            with seeded(self._seed), self._method.sources.watch():
                prediction = call(predict, *arguments, unit=self._method.answers_in(unit))
        about, answered, beyond = self._store.manifest.depth, self._method.answers_in(unit), 0.0
        if prediction.depth is not None:
            # Clip to the set's ends.
            beyond = about.beyond(prediction.depth, answered)
            depth, sigma = about.answer_of_unit(prediction.depth, prediction.sigma, answered)
            prediction = replace(prediction, depth=depth, sigma=sigma)
        protocols = self._protocols
        return record_of(self._store, images, prediction, protocols, answered, beyond), prediction

    def warm_up(self, pair: Pair) -> None:
        """Let the method load and compile, untimed, what its first call would."""
        with one_at_a_time():
            self._warm_up(self._images(pair))

    def _images(self, pair: Pair) -> Capture:
        usual = self._store.manifest.pair_images
        return self._store.read(pair).two_of(self._method.two_images(usual))

    def _warm_up(self, images: Capture) -> None:
        if self._method.warm_up and not self._warm:
            if not (images.is_pair or self._method.takes_stack):
                # A method of pairs that also takes stacks is warmed up on a pair.
                images = images.two_of((0, 1))
            with seeded(self._seed), self._method.sources.watch():
                call(self._method.warm_up, *self._method.called_on(images)[1])
        self._warm = True


@dataclass(frozen=True)
class RemoteEvaluator:
    """Do the same in another process, which opens the store and loads the method itself.

    Parameters
    ----------
    place : str
        The store's path or URL.
    entry, parameters : str
        The method, and the parameters that the user set, as JSON.
    seed : int
        As for `PairEvaluator`.
    learned : bytes or None
        What the method's fit learned here, from `pack`; None if it has no fit.
    given_blur, split
        As for `dfdbench.evaluation.loading.load_for`.
    expected : str
        The files and versions of the process that began the run, as JSON.
    """

    place: str
    entry: str
    parameters: str
    seed: int
    learned: bytes | None = field(default=None, repr=False)
    given_blur: bool = False
    split: str = "test"
    expected: str = field(default="{}", repr=False)

    @classmethod
    def of(
        cls, store: Dataset, method: Method, seed: int, split: str = "test", fit: Fit | None = None
    ) -> Self:
        """Return the evaluator for a store that is open and a method that is fitted here."""
        place = store.path.absolute() if is_local(store.path) else store.path
        learned = None if fit is None or fit.learned is None else pack(fit.learned)
        given = store.manifest.on_track and "recipe" in method.uses
        parameters = json.dumps(method.parameters)
        expected = json.dumps({"software": software(), "used": method.used})
        # A worker may have been started in another folder.
        file, colon, name = method.entry.rpartition(":")
        is_file = file.endswith((".py", ONNX))
        entry = f"{os.path.abspath(file)}{colon}{name}" if is_file else method.entry
        return cls(str(place), entry, parameters, seed, learned, given, split, expected)

    def __call__(self, pair: Pair) -> Evaluated:
        """Evaluate one pair; its time is marked as not comparable.

        Raises
        ------
        MethodError
            If this process has other versions, or another version of the method.
        """
        method, evaluate = _evaluator_here(self)
        record, answer = evaluate(pair)
        record = record.model_copy(update={"timed_alone": False})
        return Evaluated(record, answer, method.used, _environment_here())


@lru_cache(maxsize=1)
def _evaluator_here(remote: RemoteEvaluator) -> tuple[Method, PairEvaluator]:
    # A process keeps what it loaded, since graph cuts compile and networks read their weights.
    store = Dataset(remote.place)
    parameters = json.loads(remote.parameters)
    method = load_for(store, remote.entry, parameters, remote.seed, remote.given_blur, remote.split)
    _require_same(json.loads(remote.expected), method)
    if remote.learned is not None:
        restore(method, unpack(remote.learned))
    return method, PairEvaluator(store, method, remote.seed)


def _require_same(expected: dict[str, Hashes], method: Method) -> None:
    here = software()
    differing = [
        f"{name} is {here.get(name)}, not {version}"
        for name, version in expected.get("software", {}).items()
        if here.get(name) != version
    ]
    differing += changes(expected.get("used", {}), method.used)
    if differing:
        what = f"a worker would run another version of the method: {'; '.join(differing)}"
        fix = "give the workers the same environment and files, and start them again"
        raise MethodError(what, where=f"{method.entry}, on {platform.node()}", fix=fix)


# Called after the first pair, since a method may load PyTorch only then.
_environment_here = lru_cache(maxsize=1)(describe_environment)


def record_of(
    store: Dataset,
    images: Capture,
    prediction: Prediction,
    protocols: Iterable[Protocol],
    unit: Unit,
    beyond: float = 0.0,
) -> PairResult:
    """Return a pair's record: its prediction scored under every protocol, or its error.

    Parameters
    ----------
    store : Dataset
        The data set.
    images : Capture
        The pair.
    prediction : Prediction
        Depth levels, or why there are none.
    protocols : iterable of Protocol
        The protocols to score under; `SURE` is added if pixels have a sigma or no answer.
    unit : {"levels", "metres"}
        The unit of the answer.
    beyond : float
        The share of its pixels that were beyond the set's ends.
    """
    warnings = []
    if prediction.printed:
        first = prediction.printed.strip().splitlines()[:1]
        warnings.append(f"{_PRINTED} {len(prediction.printed)} characters: {''.join(first)[:80]}")
    blank = blank_record(images.pair, "failed")
    depth, sigma = prediction.depth, prediction.sigma
    if depth is None:
        return blank.model_copy(update={"error": prediction.error, "warnings": warnings})
    about, crop = store.manifest.depth, store.manifest.network_crop
    truth, answered = images.truth, ~np.isnan(depth)
    chosen = {protocol.label: protocol for protocol in protocols}
    if sigma is not None or not answered.all():
        chosen[SURE] = RELEASED[SURE]
    scores = {
        label: score(protocol, truth, images.valid, depth, crop, about.scale, about.kind, sigma)
        for label, protocol in chosen.items()
    }
    regions = regions_of(truth, images.valid, images.shown[0], about.ends)
    return blank.model_copy(
        update={
            "status": "ok",
            "seconds": prediction.seconds,
            "prediction_sha256": answer_digest(depth, sigma),
            "answered": float(answered.mean()),
            "regions": region_errors(truth, depth, regions, about.span),
            "scores": {name: pair_scores(scored) for name, scored in scores.items()},
            "numbers": prediction.numbers,
            "warnings": warnings + _oddities(about, images, depth, unit, beyond),
        }
    )


def _oddities(
    about: Depth, images: Capture, depth: NDArray[np.float32], unit: Unit, beyond: float
) -> list[str]:
    """Return what looks like a mistake of unit or direction in a depth map."""
    odd = []
    known = images.valid & ~np.isnan(depth)
    likeness = correlation(images.truth[known], depth[known])
    if likeness < AGAINST:
        odd.append(f"{_TURNED}: correlation {likeness:.2f} over the known pixels")
    if unit == "levels" and in_few_levels(about.exact_levels(depth)):
        odd.append(FEW_LEVELS)
    if beyond > _MOST_BEYOND:
        odd.append(f"{_BEYOND} ({beyond:.0%})")
    return odd


def blank_record(pair: Pair, status: str) -> PairResult:
    """Return the record of a pair that was not evaluated."""
    return PairResult(id=pair.id, scene=pair.scene, coordinates=pair.at, status=status)  # type: ignore[arg-type]


def warned(
    manifest: Manifest,
    pairs: list[PairResult],
    evaluated: list[PairResult],
    environments: list[Environment],
) -> list[str]:
    """Return the warnings that follow from a run's pairs and from where they were run."""
    warnings = []
    if missing := [pair.id for pair in pairs if pair.status == "missing"]:
        warnings.append(
            f"the store lacks {len(missing)} of {len(pairs)} pairs of the split, and there is no "
            f"average: {listed(missing, _NAMED)}"
        )
    if printed := _how_many(pairs, _PRINTED):
        warnings.append(f"the method printed to standard output on {counted(printed, 'pair')}")
    for pair in evaluated:
        warnings += [
            f"{text} ({pair.id}): the scores cannot be reproduced; does it need a seed?"
            for text in pair.warnings
            if text.startswith(_DIFFERS)
        ]
    turned = _how_many(evaluated, _TURNED)
    # A flat board shows no direction, so half of the pairs are enough for a warning.
    if turned and 2 * turned >= len(evaluated):
        # A method that answers in metres without saying so is reversed on a set in metres.
        metres = ", and metres larger for farther" if manifest.depth.scale else ""
        warnings.append(
            f"{_TURNED} on {turned} of {len(evaluated)} pairs: {manifest.stem} wants brighter for "
            f"{manifest.depth.direction}{metres}"
        )
    if evaluated and _how_many(evaluated, FEW_LEVELS) == len(evaluated):
        warnings.append(FEW_LEVELS)
    if beyond := _how_many(evaluated, _BEYOND):
        warnings.append(f"{_BEYOND} ({counted(beyond, 'pair')})")
    if together := sum(not pair.timed_alone for pair in evaluated):
        pairs_together = counted(together, "pair")
        warnings.append(f"{pairs_together} ran several at once: times are not comparable")
    there = [environments[machine] for machine in {pair.machine for pair in evaluated}]
    machines = {(each.platform, each.cpu, each.cpu_count, each.gpu) for each in there}
    if len(machines) > 1:
        warnings.append(f"the pairs were run on {len(machines)} machines: times are not comparable")
    return warnings


def _how_many(pairs: list[PairResult], begins: str) -> int:
    return sum(any(text.startswith(begins) for text in pair.warnings) for pair in pairs)
