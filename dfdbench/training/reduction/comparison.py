"""Compare reduced networks with their original: mean with mean, best with best."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean

from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, unknown_name
from dfdbench.methods.networks.inference import Predictor, find_device
from dfdbench.methods.networks.weights import Card, load_weights
from dfdbench.metrics.metric import METRICS, RANKED_BY
from dfdbench.results.wording import NOTHING, score_text, seconds_text
from dfdbench.tables.table import Table
from dfdbench.training.reduction.reduce import BASELINE
from dfdbench.training.scoring import PROTOCOL

_TURNS = 9


def configurations_in(folder: Path, names: Sequence[object] | None) -> dict[str, str]:
    """Return the configurations that ``dfdbench thesis reduce`` wrote into a folder, by row.

    Parameters
    ----------
    folder : Path
        If they lie.
    names : sequence, optional
        Which rows; by default all, the network that was counted first.

    Raises
    ------
    InputError
        If the folder holds none.
    UnknownNameError
        If there is no such row; near misses are named.
    """
    there = {path.stem: str(path) for path in sorted(folder.glob("*.toml"))}
    if BASELINE not in there:
        what = f"the folder lacks {BASELINE}.toml, which dfdbench thesis reduce writes"
        raise InputError(
            what, where=str(folder), fix="name a folder that dfdbench thesis reduce wrote"
        )
    chosen = (
        list(map(str, names))
        if names
        else [BASELINE, *(name for name in there if name != BASELINE)]
    )
    for name in chosen:
        if name not in there:
            raise unknown_name("row", name, there)
    return {name: there[name] for name in chosen}


def seconds_an_image(weights: Mapping[str, Path], store: Dataset, device: str) -> dict[str, float]:
    """Return how long each network takes for the first pair of a store, warmed up.

    The shortest of nine runs each, taken in turns, so that other load on the machine slows all of
    them.

    Parameters
    ----------
    weights : mapping of str to Path
        A file of weights, by row.
    store : Dataset
        If the pair lies.
    device : str
        As for the methods.
    """
    found = find_device(device)
    networks = {
        name: Predictor(load_weights(path, "dfd-net")[0], found) for name, path in weights.items()
    }
    images = store.read(store.pairs("all")[0])
    seconds = dict.fromkeys(networks, math.inf)
    for turn in range(_TURNS + 1):
        for name, predict in networks.items():
            begin = time.perf_counter()
            predict(images.infocus, images.defocus)
            if turn:
                seconds[name] = min(seconds[name], time.perf_counter() - begin)
    return seconds


def comparison_table(
    title: str,
    cards: Sequence[tuple[str, Card]],
    seconds: Mapping[str, float],
    protocol: str = PROTOCOL,
) -> Table:
    """Tabulate each network's parameters, seconds, scores and distance from the baseline.

    Parameters
    ----------
    title : str
        Of the table.
    cards : sequence of (str, Card)
        The row's name and the card of each training that has ended.
    seconds : mapping of str to float
        Seconds an image, by row.
    protocol : str
        The label of one of `dfdbench.training.scoring.LOGGED`.
    """
    by_row: dict[str, list[Card]] = {}
    for name, card in cards:
        by_row.setdefault(name, []).append(card)
    found = {name: _best_and_mean(group, protocol) for name, group in by_row.items()}
    rows, records = [], []
    for name, group in by_row.items():
        best, mean = (
            {metric: of_metric[number] for metric, of_metric in found[name].items()}
            for number in (0, 1)
        )
        apart = _apart(found[name], found.get(BASELINE, {}))
        cells = [name, f"{group[0].parameters:,}", seconds_text(seconds.get(name)), str(len(group))]
        for metric in METRICS:
            cells += [score_text(best.get(metric)), score_text(mean.get(metric))]
        cells += [NOTHING if value is None else f"{value:+.4f}" for value in apart]
        rows.append(tuple(cells))
        record: dict[str, object] = {"name": name, "parameters": group[0].parameters}
        record |= {"seconds": seconds.get(name), "trainings": len(group)}
        record |= {f"{metric}_best": best.get(metric) for metric in METRICS}
        record |= {f"{metric}_mean": mean.get(metric) for metric in METRICS}
        record |= {"best_to_best": apart[0], "mean_to_mean": apart[1], "protocol": protocol}
        records.append(record)
    shown = METRICS[RANKED_BY].title
    columns = ["network", "parameters", "seconds per image", "trainings"]
    for of in METRICS.values():
        columns += [f"best {of.heading}", "mean"]
    columns += [f"{shown}: best less its best", "mean less its mean"]
    some = cards[0][1]
    notes = (
        f"{some.method} on {some.dataset}, protocol {protocol}. The best is over the seeds, each "
        f"metric by itself. The last two columns compare with {BASELINE}.",
        "A best beside another's mean says nothing: the best of several trainings of the same "
        "network lies below its own mean as well.",
    )
    align = "l" + "r" * (len(columns) - 1)
    return Table(title, tuple(columns), tuple(rows), align, notes, records=tuple(records))


def _best_and_mean(group: Sequence[Card], protocol: str) -> dict[str, tuple[float, float]]:
    of_each = [card.scores_under(protocol) for card in group]
    found = {}
    for name, metric in METRICS.items():
        if all(name in scores for scores in of_each):
            values = [scores[name] for scores in of_each]
            best = (max if metric.larger_is_better else min)(values)
            found[name] = best, fmean(values)
    return found


def _apart(
    found: Mapping[str, tuple[float, float]], baseline: Mapping[str, tuple[float, float]]
) -> tuple[float | None, float | None]:
    if RANKED_BY not in found or RANKED_BY not in baseline:
        return None, None
    (best, mean), (its_best, its_mean) = found[RANKED_BY], baseline[RANKED_BY]
    return best - its_best, mean - its_mean
