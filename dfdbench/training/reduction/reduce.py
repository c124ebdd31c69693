"""Write configurations of narrower networks, and compare them with the thesis."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any, Literal

import torch

from dfdbench.blur.recipe import LEVELS as DEPTH_LEVELS
from dfdbench.datasets.dataset import Dataset
from dfdbench.errors import InputError, unknown_name
from dfdbench.methods.networks.choices import LAYERS, TIED
from dfdbench.methods.networks.inference import Predictor, find_device
from dfdbench.methods.networks.weights import Card, build_network, count_parameters, load_weights
from dfdbench.metrics.metric import METRICS, RANKED_BY
from dfdbench.results.wording import NOTHING, score_text, seconds_text
from dfdbench.system.files import write_whole
from dfdbench.system.parallel import OnDone
from dfdbench.system.text import toml_text
from dfdbench.tables.render import render
from dfdbench.tables.table import Format, Table, grouped
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.reduction import counts as counting

Widths = tuple[int, ...]
Rounding = Literal["H", "L"]
#: The layers of each level; the last stage counts 27 again, as in Table D.2.
LEVELS: Mapping[int, tuple[int, ...]] = {
    1: (52, 48, 45, 15, 12, 8, 5),
    2: (42, 40, 37, 27, 24, 20, 17),
    3: (34, 32, 29, 27),
}
_MULTIPLE = 8
# Table D.2's numbering of the iterative rows, inferred from its widths; the ensemble's is as
# listed.
_ITERATIVE: tuple[counting.Statistic, ...] = ("min", "max", "mean")
#: What a configuration says of a network's layers besides their widths.
_OF_LAYERS = ("sampling_size", "first_activation", "kernels", "activations", "normalized")
#: The row to which all others are compared: the network that was counted, unchanged.
BASELINE = "original"


@dataclass(frozen=True)
class Reduction:
    """The narrower networks that follow from the counts of a network's layers.

    Parameters
    ----------
    rows : mapping of str to tuple of int
        Widths by the row's name, input to output, `BASELINE` first.
    tables : tuple of Table
        The counts, as in Table D.1, and the rows, as in Table D.2.
    files : mapping of str to str
        A configuration for each row, by file name.
    """

    rows: Mapping[str, Widths]
    tables: tuple[Table, Table]
    files: Mapping[str, str]

    def write(self, folder: Path) -> None:
        """Write tables and configurations, replacing those of an earlier call."""
        folder.mkdir(parents=True, exist_ok=True)
        earlier = folder / "rows.csv"
        # Their first column names the files; others may lie beside them.
        lines = earlier.read_text("utf-8", "replace").splitlines() if earlier.exists() else []
        for old in folder.glob("*.toml"):
            if any(line.startswith(f"{old.stem},") for line in lines):
                old.unlink()
        for name, text in self.files.items():
            write_whole(folder / name, text)
        for name, table in zip(("counts", "rows"), self.tables, strict=True):
            write_tables(folder / name, [table])


def write_tables(place: Path, tables: Sequence[Table]) -> None:
    """Write tables as Markdown and as CSV, under one name with two endings."""
    for format, suffix in ((Format.markdown, ".md"), (Format.csv, ".csv")):
        write_whole(place.with_suffix(suffix), render(tables, format))


def reduce_weights(
    weights: Path,
    store: Dataset,
    configuration: TrainingConfiguration,
    split: str = "test",
    level: int | None = None,
    rounding: Rounding | None = None,
    seed: int = 0,
    tuning: counting.Tuning = "own",
    device: torch.device | None = None,
    on_sample: OnDone | None = None,
) -> Reduction:
    """Count the distinct outputs of a trained DfD-Net's layers, and cut its widths to fit (6.2).

    Parameters
    ----------
    weights : Path
        A file from ``dfdbench train dfd-net``.
    store : Dataset
        The store of the samples, the first pair of each scene.
    configuration : TrainingConfiguration
        How to train the rows; widths and layers come from the weights.
    split : str
        The split whose scenes are sampled; the thesis uses the test's.
    level : int, optional
        Return the iterative rows F of this level; else the ensemble rows B.
    rounding : {"H", "L"}, optional
        Also add each row rounded up or down to multiples of 8.
    seed, tuning
        Of the maps, see `dfdbench.training.reduction.counts.count_clusters`.
    device : torch.device, optional
        Where the network runs, by default the processor.
    on_sample : callable, optional
        Called with (samples done, total samples).

    Raises
    ------
    MethodError
        If the weights cannot be read or belong to another network.
    InputError
        If a sample is too small, or there is no such level.
    """
    network, card = load_weights(weights, "dfd-net")
    network = network.to(device or torch.device("cpu"))
    counts = counting.count_clusters(
        network, store, counting.samples_of(store, split), seed, tuning, on_sample
    )
    base = tuple(int(width) for width in card.architecture["filters"])
    clusters = {name: counts.widths(name) for name in counting.STATISTICS}
    found = ensemble_rows(clusters) if level is None else iterative_rows(clusters, level, base)
    rows = {BASELINE: base, **found, **(rounded(found, rounding) if rounding else {})}
    # Keep everything else of the network: a row has the same layers, only narrower ones.
    fields = TrainingConfiguration.model_fields
    kept = {name: card.architecture.get(name, fields[name].default) for name in _OF_LAYERS}
    same = configuration.model_copy(update=kept)
    what = f"{weights.stem}, {card.trained_on}"
    counted = f"counted on {store.manifest.stem}, split {split}, one pair a scene"
    files = {
        f"{name}.toml": as_toml(same, widths, f"{name} of {what}; {counted}.")
        for name, widths in rows.items()
    }
    parameters = {name: _parameters(card.architecture, widths) for name, widths in rows.items()}
    tables = (
        counting.counts_table(counts, f"Clusters of each layer's outputs: {what}; {counted}"),
        rows_table(rows, parameters, f"Filters of the reduced networks: {what}"),
    )
    return Reduction(rows, tables, files)


def _parameters(architecture: Mapping[str, object], widths: Widths) -> int:
    with torch.device("meta"):
        return count_parameters(build_network("dfd-net", {**architecture, "filters": list(widths)}))


def ensemble_rows(counts: Mapping[counting.Statistic, Mapping[int, int]]) -> dict[str, Widths]:
    """Return the widths of B-01-01 to B-03-03, input to output: all layers are reduced at once.

    The thesis does not state the rule. We inferred it from Tables D.1 and D.2; it derives all nine
    rows of the latter from the former. The first number is the statistic over the samples: minimum,
    mean, maximum. The second is the width of layers that are added to each other: the smaller
    count, the larger, or the larger with layer 2's count for layers 12 and 5.

    Parameters
    ----------
    counts : mapping
        For each statistic, the counts by layer; layer 1 keeps its width of 256.

    Examples
    --------
    >>> every = dict.fromkeys((*LAYERS[:-1], 2), 30) | {12: 20, 2: 10}
    >>> rows = ensemble_rows({"min": every, "mean": every, "max": every})
    >>> [rows[name][14:17] for name in ("B-01-01", "B-01-02", "B-01-03")]
    [(20, 30, 20), (30, 30, 30), (10, 30, 10)]
    """
    return {
        f"B-0{number}-0{choice}": _row(dict(counts[statistic]), choice)
        for number, statistic in enumerate(counting.STATISTICS, 1)
        for choice in (1, 2, 3)
    }


def iterative_rows(
    counts: Mapping[counting.Statistic, Mapping[int, int]], level: int, base: Sequence[int]
) -> dict[str, Widths]:
    """Return the widths to try on one level; all other layers keep theirs (6.2).

    Levels follow each other: train level 1's best row from scratch, count level 2 on it, and so on.
    The rows of level 3 are F-01-01 to F-03-02, numbered as in Table D.2: minimum, maximum, mean;
    the smaller, the larger. The thesis does not name those of earlier levels; we call them F1-...
    and F2-....

    Parameters
    ----------
    counts : mapping
        For each statistic, the counts by layer, on the network of `base`.
    level : int
        1 to 3.
    base : sequence of int
        The widths of that network, input to output.

    Raises
    ------
    InputError
        If there is no such level.
    """
    if level not in LEVELS:
        raise InputError(f"there is no level {level}, only 1, 2 and 3", where="level")
    before = dict(zip(LAYERS, base, strict=True))
    prefix = "F" if level == max(LEVELS) else f"F{level}"
    rows = {}
    for number, statistic in enumerate(_ITERATIVE, 1):
        # Layer 2 determines the width of 12 and 5, which are in level 1.
        for choice in (1, 2, 3) if level == 1 else (1, 2):
            full = dict(zip(LAYERS, _row(dict(counts[statistic]), choice), strict=True))
            chosen = before | {layer: full[layer] for layer in LEVELS[level]}
            rows[f"{prefix}-0{number}-0{choice}"] = tuple(chosen[layer] for layer in LAYERS)
    return rows


def rounded(rows: Mapping[str, Widths], rounding: Rounding) -> dict[str, Widths]:
    """Return rows rounded to multiples of 8, up (H) or down (L, at least 8); layer 1 stays.

    H turns F-02-02 into F-02-02H. The thesis calls F-02-02L rounded down but prints a mixture; L
    always rounds down.

    Examples
    --------
    >>> row = {"F-9": (*[45] * 17, 256)}
    >>> rounded(row, "H")["F-9H"][0], rounded(row, "L")["F-9L"][0]
    (48, 40)
    """

    def to_multiple(width: int) -> int:
        up = width + _MULTIPLE - 1 if rounding == "H" else width
        return max(1, up // _MULTIPLE) * _MULTIPLE

    return {
        f"{name}{rounding}": (*map(to_multiple, widths[:-1]), widths[-1])
        for name, widths in rows.items()
    }


def _row(counts: dict[int, int], choice: int) -> Widths:
    for one, other in TIED:
        chosen = (min if choice == 1 else max)(counts[one], counts[other])
        counts[one] = counts[other] = chosen
    if choice == 3:
        counts[12] = counts[5] = counts[2]
    return (*(counts[layer] for layer in LAYERS[:-1]), DEPTH_LEVELS)


def rows_table(rows: Mapping[str, Widths], parameters: Mapping[str, int], title: str) -> Table:
    """Return rows in the form of Table D.2, with each network's number of parameters."""
    lines = tuple(
        (name, *map(str, widths), f"{parameters[name]:,}") for name, widths in rows.items()
    )
    columns = ("name", *map(str, LAYERS), "parameters")
    return Table(title, columns, lines, "l")


def as_toml(configuration: TrainingConfiguration, widths: Widths, comment: str) -> str:
    """Return a commented configuration that trains a network of these widths.

    Examples
    --------
    >>> print(as_toml(TrainingConfiguration(narrow=8), (4, 256), "of mine").splitlines()[2])
    filters = [4, 256]
    """
    others = configuration.model_dump(mode="json", exclude_none=True, exclude={"filters", "narrow"})
    choices = toml_text({"filters": list(widths), "narrow": 1, **others})
    return f"# {comment}\n\n{choices}"


_TURNS = 9


def configurations_in(folder: Path, names: Sequence[object] | None) -> dict[str, str]:
    """Return the configurations in a folder from ``dfdbench thesis reduce``, by row.

    Parameters
    ----------
    folder : Path
        The folder of the configurations.
    names : sequence, optional
        Which rows; by default all, starting with the network that was counted.

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
        fix = "name a folder that dfdbench thesis reduce wrote"
        raise InputError(what, where=str(folder), fix=fix)
    chosen = list(map(str, names or dict.fromkeys([BASELINE, *there])))
    for name in chosen:
        if name not in there:
            raise unknown_name("row", name, there)
    return {name: there[name] for name in chosen}


def seconds_an_image(weights: Mapping[str, Path], store: Dataset, device: str) -> dict[str, float]:
    """Return each network's time for the first pair of a store, warmed up.

    It is the shortest of nine runs each, taken in turns, so that other load on the machine slows
    all networks alike.

    Parameters
    ----------
    weights : mapping of str to Path
        A file of weights, by row.
    store : Dataset
        The store of the pair.
    device : str
        As for the methods.
    """
    found = find_device(device)
    networks = {
        name: Predictor(load_weights(path, "dfd-net")[0], found) for name, path in weights.items()
    }
    images = store.read(store.pairs("all")[0]).two_of(store.manifest.pair_images)
    seconds = dict.fromkeys(networks, math.inf)
    for turn in range(_TURNS + 1):
        for name, predict in networks.items():
            begin = time.perf_counter()
            predict(images.infocus, images.defocus)
            if turn:
                seconds[name] = min(seconds[name], time.perf_counter() - begin)
    return seconds


def comparison_table(
    title: str, cards: Sequence[tuple[str, Card]], seconds: Mapping[str, float], protocol: str
) -> Table:
    """Tabulate each network's parameters, seconds, scores and distance from the baseline.

    Parameters
    ----------
    title : str
        The table's title.
    cards : sequence of (str, Card)
        The row's name and the card of each finished training.
    seconds : mapping of str to float
        Seconds per image, by row.
    protocol : str
        The label of one of `dfdbench.training.task.LOGGED`.
    """
    by_row = grouped(cards).items()
    records = [_record(name, group, seconds.get(name), protocol) for name, group in by_row]
    baseline = next((record for record in records if record["name"] == BASELINE), {})
    rows = []
    for record in records:
        for kind in ("best", "mean"):
            ends: list[Any] = [of.get(f"{RANKED_BY}_{kind}") for of in (record, baseline)]
            apart = None if None in ends else ends[0] - ends[1]
            record[f"{kind}_to_{kind}"] = apart
        record["protocol"] = protocol
        cells = [record["name"], f"{record['parameters']:,}", seconds_text(record["seconds"])]
        cells.append(str(record["trainings"]))
        for metric in METRICS:
            cells += [score_text(record[f"{metric}_{kind}"]) for kind in ("best", "mean")]
        differences = (record["best_to_best"], record["mean_to_mean"])
        cells += [NOTHING if value is None else f"{value:+.4f}" for value in differences]
        rows.append(tuple(cells))
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
    return Table(title, tuple(columns), tuple(rows), "l", notes, records=tuple(records))


def _record(
    name: str, group: Sequence[Card], seconds: float | None, protocol: str
) -> dict[str, Any]:
    of_each = [card.scores_under(protocol) for card in group]
    best, mean = {}, {}
    for metric, about in METRICS.items():
        values = [scores[metric] for scores in of_each if metric in scores]
        whole = len(values) == len(group)
        chosen = max if about.larger_is_better else min
        best[f"{metric}_best"] = chosen(values) if whole else None
        mean[f"{metric}_mean"] = fmean(values) if whole else None
    facts = {"name": name, "parameters": group[0].parameters, "seconds": seconds}
    return {**facts, "trainings": len(group), **best, **mean}
