"""A run's summary: its score, a constant's, the best comparable row's, its worst pairs."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from dfdbench.board.row_file import RESULTS, leaderboard_folder, read_row
from dfdbench.datasets.catalog import part_name
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import DfdbenchError, ResultError
from dfdbench.evaluation.fitting import mean_scenes
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.pair import PairEvaluator
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import RELEASED, metrics_of, ranked_by
from dfdbench.results.record import PairResult, Result, average
from dfdbench.results.saved_run import SavedRun
from dfdbench.results.summary import ranked
from dfdbench.results.wording import given_to, knew_blur, method_label, score_text
from dfdbench.tables.table import counted

#: The method that any other has to beat.
CONSTANT = "constant"
# If a part of the pairs is this much worse than all of them, name that part.
_STANDS_OUT = 1.05


#: A line of a verdict as ``text``, with its scores and names as data.
Line = dict[str, Any]


def verdict_text(lines: Mapping[str, Line]) -> str:
    """Join the lines that `verdict_facts` found, as ``dfdbench run`` ends with them."""
    return "\n".join(f"{name.replace('_', ' '):<12} {line['text']}" for name, line in lines.items())


def verdict_facts(run: SavedRun, protocol: str) -> dict[str, Line]:
    """Return a run's summary.

    Parameters
    ----------
    run : SavedRun
        The run.
    protocol : str
        The protocol.

    Returns
    -------
    dict of str to Line
        ``score``: the means; ``constant``: that of ``constant`` on the same pairs; ``best_row``:
        the best row on the same data whose method was given as much (else the best of all), scored
        on the same pairs; ``worst``: where the run is worst. Each has a ``text``, and scores by
        metric. Missing lines are left out, all but the first if pixels lack answers, and so is a
        damaged row of the leaderboard.
    """
    result = run.result
    lines: dict[str, Line] = {"score": _score(result, protocol)}
    name = ranked_by(protocol)[0]
    if any(pair.lacks_answers(protocol, name) for pair in result.evaluated):
        # The method chose the pairs that have a score.
        return lines
    pairs = [pair for pair in result.pairs if _of(pair, protocol) is not None]
    own = mean_of(_of(pair, protocol) for pair in pairs)
    if own is not None:
        title = metrics_of(protocol)[name].title
        others = list(_others(result, protocol, [pair.id for pair in pairs]))
        row = next((row.result for row in others if row.name == CONSTANT), None)
        if row and run.store:
            # The row of another split may know the mean of scenes that are tested here.
            own_mean = mean_scenes(run.store.manifest, result.dataset.split)[0]
            row = row if row.method.trained_on == own_mean else None
        known = row.pairs if row else run.store
        if result.method.name != CONSTANT and known is not None:
            lines |= _constant(known, pairs, protocol, own, result.dataset.split)
        lines |= _best(result, own, name, title, others)
        lines |= _worst(result, protocol, pairs, own, title)
    return lines


class _Row(NamedTuple):
    """A run of the leaderboard: its method's card, its result, its mean on this run's pairs."""

    name: str
    result: Result
    mean: float


def _score(result: Result, protocol: str) -> Line:
    """Return the mean scores; for an incomplete run, those of the pairs that were run, and why."""
    data, count = result.dataset, counted(result.dataset.expected, "pair")
    under = f"protocol {protocol}, split {data.split}"
    done = result.evaluated
    if gaps := sum(pair.lacks_answers(protocol) for pair in done):
        why = f"{counted(gaps, 'pair')} without an answer for every pixel"
        return {"text": f"none: {why}  ({under}; --protocol sure)"}
    if len(done) < data.expected:
        missing = sum(pair.status == "missing" for pair in result.pairs)
        absent = f"; {counted(missing, 'pair')} not in the store" if missing else ""
        count = f"only {len(done)} of {count}{absent}"
    if not done:
        return {"text": f"none: {count} were evaluated  ({under})"}
    means, scores = _means(done, protocol)
    return means | {"pairs": len(done), "text": f"{scores}  ({under}, {count})"}


def _means(pairs: list[PairResult], protocol: str) -> tuple[dict[str, float | None], str]:
    """Return the means of evaluated pairs, by metric, and their text."""
    metrics, means = metrics_of(protocol), average(pairs, [protocol])[protocol]
    texts = (f"{metrics[name].title} {score_text(mean)}" for name, mean in means.items())
    return means, "  ".join(texts)


def _others(result: Result, protocol: str, ids: Sequence[str]) -> Iterator[_Row]:
    """Yield the rows on the same data that have a score for each of the pairs."""
    stem = part_name(result.dataset.name)[0]
    for file in sorted((leaderboard_folder() / RESULTS).glob(f"{stem}-*/*.json")):
        try:
            there = read_row(file).results_on(result.dataset.fingerprint)
        except ResultError:
            # `dfdbench leaderboard` reports it; this run's score is valid without the row.
            continue
        for other in there:
            if knew_blur(other.method, other.dataset.degradation):
                continue
            scores = {pair.id: _of(pair, protocol) for pair in other.pairs}
            found = [scores.get(name) for name in ids]
            mean = None if None in found else mean_of(found)
            if mean is not None:
                yield _Row(file.stem, other, mean)


def _constant(
    known: Sequence[PairResult] | Dataset,
    pairs: Sequence[PairResult],
    protocol: str,
    own: float,
    split: str,
) -> dict[str, Line]:
    """Return the score of the training mean on some pairs, from its row or else computed."""
    if isinstance(known, Dataset):
        try:
            # Of a stack, too, it needs only the size of two images.
            method = load_for(known, CONSTANT, {"images": "0,1"}, split=split)
        except DfdbenchError:
            # The training scenes have no depth.
            return {}
        evaluate = PairEvaluator(known, method, 0, [RELEASED[protocol]])
        found = [evaluate(pair.pair)[0] for pair in pairs]
    else:
        wanted = {pair.id for pair in pairs}
        found = [pair for pair in known if pair.id in wanted]
    means, scores = _means(found, protocol)
    metric = ranked_by(protocol)[0]
    title, mean = metrics_of(protocol)[metric].title, means[metric]
    if mean is None:
        return {}
    beside = _beside(own, mean).replace("yours", f"your {title}")
    return {"constant": means | {"text": f"{scores}: {beside}"}}


def _of(pair: PairResult, protocol: str) -> float | None:
    """Return a pair's score by the ranking metric."""
    return pair.score(protocol, ranked_by(protocol)[0])


def _beside(own: float, other: float) -> str:
    """Compare two scores.

    Examples
    --------
    >>> _beside(0.1305, 0.1306), _beside(0.2, 0.1)
    ('yours is under 1 % lower', 'yours is 100 % higher')
    """
    if score_text(own) == score_text(other):
        return "yours is the same"
    far = f"{100 * abs(own / other - 1):.0f} %" if other else "much"
    far = "under 1 %" if far == "0 %" else far
    return f"yours is {far} {'lower' if own < other else 'higher'}"


def _kind(result: Result) -> str:
    """Return what a method was given, whatever its weights were trained on."""
    given = re.sub(r"trained on .*", "trained weights", given_to(result))
    given = re.sub(r"(mean|median) depth", r"the \1 depth", given)
    given = given.replace("training pairs", "the training pairs")
    return given.replace("blur fitted", "a fitted blur").replace(", ", " and ")


def _best(
    result: Result, own: float, metric: str, title: str, others: Sequence[_Row]
) -> dict[str, Line]:
    """Return the best row whose method was given as much; if there is none, the best of all."""
    label = method_label(result.method)
    rows = [r for r in others if r.name != CONSTANT and method_label(r.result.method) != label]
    if not rows:
        return {}
    alike = [row for row in rows if _kind(row.result) == _kind(result)]
    best = min(alike or rows, key=lambda row: row.mean)
    given = _kind(best.result)
    text = f"{best.name}: {title} {score_text(best.mean)}"
    if alike:
        text += f", given as much ({given}); {_beside(own, best.mean)}"
    else:
        text += f", but it was given {given}, and yours {_kind(result)}"
    facts = {"row": best.name, "given": given, "given_as_much": bool(alike)}
    return {"best_row": facts | {metric: best.mean, "text": text}}


def _worst(
    result: Result, protocol: str, pairs: Sequence[PairResult], own: float, title: str
) -> dict[str, Line]:
    """Return where the mean is highest, by scene or an axis, and the worst pair."""
    groups: dict[str, list[float]] = {}
    for pair in pairs:
        for name, value in {"scene": pair.scene, **pair.coordinates}.items():
            groups.setdefault(f"{name} {value}", []).append(_of(pair, protocol) or 0.0)
    means = {place: mean_of(found) or 0.0 for place, found in groups.items() if len(found) > 1}
    last = ranked(result, protocol)[-1]
    score = _of(last, protocol)
    text = f"pair {last.id}, {title} {score_text(score)}"
    place = max(means, key=means.__getitem__, default="")
    if place and means[place] > _STANDS_OUT * own:
        text = f"{place}, {title} {score_text(means[place])} on average; {text}"
    line = {"pair": last.id, ranked_by(protocol)[0]: score, "text": text}
    return {"worst": line} if len(pairs) > 1 else {}
