"""Parameters chosen on training captures, by cross-validation over their groups."""

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any

import pandas as pd

from dfdbench.datasets.dataset import Captures, Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.errors import InputError, MethodError
from dfdbench.evaluation.fitting import TRAINING
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.pair import PairEvaluator
from dfdbench.methods.method import teach
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import SURE, find_protocol, ranked_by
from dfdbench.results.record import protocol_on
from dfdbench.results.wording import plain, score_text
from dfdbench.tables.table import Table

#: Training captures are divided into so many folds; those of a group stay together.
FOLDS = 4


def cross_validate(
    store: Dataset,
    method: str | Callable[..., Any],
    ranges: Mapping[str, Sequence[Any]] | None,
    parameters: Mapping[str, Any],
    protocol: str | None,
    limit: int | None,
    seed: int,
    on_pair: Callable[[int, int], None] | None,
) -> pd.DataFrame:
    """Score every combination of parameters on training captures that it was not fitted on.

    The captures are divided into four folds, those of a group together. For each fold the method
    is fitted on the other three, if it has a fit, and scored on the fold.
    Parameters, answer and errors are those of `dfdbench.tune`.
    """
    loaded = load_for(store, method, parameters, seed)
    ranges = dict(ranges or loaded.attribute("ranges") or {})
    if not ranges or not all(ranges.values()):
        what = "nothing to try: the method states no ranges of its own"
        raise InputError(what, where=loaded.name, fix="name some: --range window=7,31,91")
    rule = find_protocol(protocol_on(store.manifest, protocol))
    folds = folds_of(store)
    trials = [dict(zip(ranges, values, strict=True)) for values in product(*ranges.values())]
    # What a method does not take is said before anything is run.
    methods = [load_for(store, method, {**parameters, **trial}, seed) for trial in trials]
    every = [pair for fold in folds for pair in fold]
    scored = set(every[:: -(-len(every) // (limit or len(every)))])
    total = len(scored) * len(trials)
    rows: list[dict[str, Any]] = []
    done = 0
    for trial, ready in zip(trials, methods, strict=True):
        found = []
        for fold in folds:
            if ready.learner is not None:
                others = tuple(pair for pair in every if pair not in fold)
                two = ready.two_images(store.manifest.pair_images)
                teach(ready, Captures(store, others, two), seed)
            evaluator = PairEvaluator(store, ready, seed, [rule])
            for pair in (pair for pair in fold if pair in scored):
                record, _ = evaluator(pair)
                where = f"{pair.id} with {words(trial)}"
                if record.error:
                    raise MethodError(record.error, where=where)
                if record.lacks_answers(rule.label):
                    what = "pixels have no answer, and no score compares those that have one"
                    raise MethodError(what, where=where, fix=f"--protocol {SURE}")
                found.append(record.scores[rule.label])
                done += 1
                if on_pair:
                    on_pair(done, total)
        rows.append({**trial, **pd.DataFrame(found).mean()})
    tried = pd.DataFrame(rows).set_index(list(ranges))
    return tried.sort_values(list(ranked_by(rule.label)), kind="stable")


def tried_table(tried: pd.DataFrame, title: str) -> Table:
    """Return the table of what `cross_validate` found."""
    metrics = {name: find_metric(name) for name in map(str, tried)}
    names = [str(name) for name in tried.index.names]
    trials = list(zip(_parameters(tried), tried.to_numpy().tolist(), strict=True))
    rows = [(*map(plain, given.values()), *map(score_text, scores)) for given, scores in trials]
    records = tuple(given | dict(zip(metrics, scores, strict=True)) for given, scores in trials)
    columns = (*names, *(metric.heading for metric in metrics.values()))
    align = "l" * len(names) + "r" * len(metrics)
    return Table(title, columns, tuple(rows), align, records=records)


def best_words(tried: pd.DataFrame) -> str:
    """Return the best parameters as the command line takes them."""
    return words(_parameters(tried)[0])


def _parameters(tried: pd.DataFrame) -> list[dict[str, Any]]:
    shown = tried.index.to_frame(index=False).astype(object)
    return [{str(name): value for name, value in row.items()} for row in shown.to_dict("records")]


def folds_of(store: Dataset) -> list[list[Pair]]:
    """Divide the training captures into folds of about one size, those of a group together.

    Raises
    ------
    InputError
        If there are fewer groups than folds.
    """
    groups: dict[str, list[Pair]] = {}
    for pair in store.pairs(TRAINING):
        groups.setdefault(store.manifest.groups.get(pair.scene, pair.scene), []).append(pair)
    if len(groups) < FOLDS:
        what = f"{len(groups)} groups of training captures are too few for {FOLDS} folds"
        raise InputError(what, where=store.manifest.stem, fix="build it with more training scenes")
    folds: list[list[Pair]] = [[] for _ in range(FOLDS)]
    # The largest first, each to the fold that has least.
    for group in sorted(groups.values(), key=len, reverse=True):
        min(folds, key=len).extend(group)
    return folds


def words(parameters: Mapping[str, Any]) -> str:
    """Return parameters as the command line takes them.

    Examples
    --------
    >>> words({"window": 31, "smoothing": 0.5})
    '--param window=31 --param smoothing=0.5'
    """
    return " ".join(f"--param {name}={plain(value)}" for name, value in parameters.items())
