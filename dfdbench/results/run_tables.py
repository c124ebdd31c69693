"""Tables of a run: scores, extremes, times, scenes."""

from collections.abc import Iterator, Mapping, Sequence

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Scene, Split
from dfdbench.metrics.intervals import INTERVAL_GROUPS
from dfdbench.metrics.metric import find_metric, mean_of
from dfdbench.metrics.protocol import SURE, metrics_of, title_of
from dfdbench.metrics.regions import REGIONS
from dfdbench.results.record import Result
from dfdbench.results.summary import RunSummary, ScoreGroup, scene_labels, summarise_scenes
from dfdbench.results.wording import score_text, without_answers
from dfdbench.tables.table import Table, counted, grouped, listed

EXTREMES = 5
_SPREAD = {"minimum": "minimum", "mean": "mean", "maximum": "maximum", "std deviation": "std"}


def region_table(results: Mapping[str, Result]) -> Table:
    """Return the NRMSE of runs at edges, in flat regions, far and near, one row per run.

    It is the mean over pairs that have such a region. A run that is incomplete or leaves pixels
    without an answer has none.

    Parameters
    ----------
    results : mapping of str to Result
        Runs on the same data, by name.
    """
    rows = []
    for name, result in results.items():
        whole = result.complete and not any(pair.answered < 1 for pair in result.pairs)
        means = (
            mean_of(pair.regions.get(region) for pair in result.pairs) if whole else None
            for region in REGIONS
        )
        rows.append((name, *map(score_text, means)))
    title = f"NRMSE by region, {next(iter(results.values())).dataset.heading}"
    notes = tuple(f"{name}: {what}" for name, what in REGIONS.items())
    return Table(title, ("method", *REGIONS), tuple(rows), "l", notes)


def run_score_table(summary: RunSummary, scenes: Sequence[Scene] = ()) -> Table:
    """Return mean and spread of each metric by lighting, like the thesis's Tables 4.3 and 5.3.

    The table's data also split the scores by the scenes' labels.
    """
    result, groups = summary.result, summary.groups
    dataset = result.dataset
    partial = any(group.evaluated < group.expected for group in groups)
    labels = _labels(result)
    metrics = metrics_of(summary.protocol)
    columns = [*labels, *(head for metric in metrics.values() for head in (metric.heading, "std"))]
    rows = []
    for group in groups:
        pairs = (f"{group.evaluated}/{group.expected}",) * partial
        rows.append((*_place(group, len(labels)), *_cells(group), *pairs))
    if partial:
        columns.append("pairs")
    state = "" if result.complete else "PARTIAL, "
    title = (
        f"{result.method.title} on {dataset.heading}, protocol {title_of(summary.protocol)} "
        f"({state}{dataset.evaluated} of {counted(dataset.expected, 'pair')})"
    )
    align = "l" * len(labels)
    notes, rules = tuple(_notes(result, groups)), _rules(groups)
    records = tuple(_records(summary, scene_labels(scenes)))
    label = f"{result.method.name} {dataset.name} {dataset.split} {summary.protocol}"
    return Table(title, tuple(columns), tuple(rows), align, notes, rules, records, label=label)


def _cells(group: ScoreGroup) -> list[str]:
    cells = []
    for found in group.metrics.values():
        ran = found.of_what_ran
        cells.append(score_text(found.mean) if ran is None else f"({score_text(ran)})")
        cells.append(score_text(found.std))
    return cells


def extremes_table(summary: RunSummary) -> Table:
    """Return the best and the worst pairs by rank, like the thesis's Table 5.2."""
    protocol, metrics = summary.protocol, metrics_of(summary.protocol)
    top = summary.ranked[:EXTREMES]
    bottom = summary.ranked[len(top) :][-EXTREMES:]
    axes = summary.result.dataset.axes
    rows, records = [], []
    for kind, pair in [*(("top", pair) for pair in top), *(("bottom", pair) for pair in bottom)]:
        scores = {name: pair.score(protocol, name) for name in metrics}
        place = (str(pair.coordinates[axis]) for axis in axes)
        rows.append((kind, pair.scene, *place, *map(score_text, scores.values())))
        records.append({"of": kind, "pair": pair.id, **scores})
    title = f"best and worst pairs, protocol {title_of(protocol)}"
    columns = ("", "scene", *axes, *(metric.heading for metric in metrics.values()))
    rules = frozenset({len(top) - 1})
    return Table(title, columns, tuple(rows), "ll", (), rules, tuple(records))


def time_table(summary: RunSummary) -> Table:
    """Return the seconds per pair by lighting, like the thesis's Table 4.4."""
    result, groups = summary.result, summary.groups
    labels = _labels(result)
    rows = [
        (*_place(group, len(labels)), score_text(group.seconds.mean), score_text(group.seconds.std))
        for group in groups
    ]
    environment = result.environment
    threads = ", ".join(f"{name} {count}" for name, count in environment.threads.items())
    machine = f"{environment.cpu}, {environment.cpu_count} cores; threads: {threads}"
    if environment.gpu:
        machine += f"; GPU: {environment.gpu}"
    alone = all(pair.timed_alone for pair in result.pairs)
    how = "one at a time" if alone else "several at once: not comparable"
    title, columns = f"seconds per pair, warm, {how}", (*labels, "mean", "std")
    return Table(title, columns, tuple(rows), "l" * len(labels), (machine,), _rules(groups))


def _notes(result: Result, groups: tuple[ScoreGroup, ...]) -> list[str]:
    whole = groups[-1]
    notes = []
    # A flat ground truth may leave some metrics fewer groups than others.
    intervals = grouped(
        (
            value.groups,
            f"{find_metric(name).title} {score_text(value.low)} to {score_text(value.high)}",
        )
        for name, value in whole.metrics.items()
        if value.low is not None
    )
    for count, parts in intervals.items():
        what = f"95 % interval of the overall mean, over {count} groups of scenes"
        if count < INTERVAL_GROUPS:
            what = f"range of the means of {count} groups of scenes, too few for an interval"
        notes.append(f"{what}: {'; '.join(parts)}")
    if whole.undefined:
        pairs = counted(whole.undefined, "pair")
        notes.append(f"without a defined score (flat ground truth), in no mean: {pairs}")
    if whole.unanswered:
        notes.append(without_answers(whole.unanswered))
    notes += _notes_of_method(result)
    failed = ((pair.error or "", pair.id) for pair in result.pairs if pair.status == "failed")
    for error, ids in grouped(failed).items():
        which = f", the first of them {ids[0]}" if len(ids) > 1 else f", {ids[0]}"
        notes.append(f"{counted(len(ids), 'pair')} failed{which}: {error}")
    texts = {"missing": "not in the store", "not-run": "not run"}
    for status, text in texts.items():
        count = sum(pair.status == status for pair in result.pairs)
        if count:
            notes.append(f"{count} of {len(result.pairs)} pairs {text}")
    if not result.complete:
        means = "; means in brackets are of what ran" if result.evaluated else ""
        notes.append(f"an incomplete run has no rank{means}")
    return notes + [f"warning: {text}" for text in result.warnings]


def _notes_of_method(result: Result) -> list[str]:
    notes = []
    if fitted := result.method.fitted_on:
        notes.append(f"fitted on {fitted}, in {result.method.fit_seconds:.1f} s")
    if chosen := result.method.chosen:
        notes.append("chosen by the fit: " + listed(f"{k} {v:g}" for k, v in chosen.items()))
    if sure := (result.averages or {}).get(SURE):
        means = (f"{find_metric(name).title} {score_text(value)}" for name, value in sure.items())
        notes.append(f"how sure it is, by protocol {SURE}: {'; '.join(means)}")
    if numbers := grouped(item for pair in result.pairs for item in pair.numbers.items()):
        means = (f"{name} {mean_of(found):.6g}" for name, found in numbers.items())
        notes.append("the method's own numbers, mean a pair: " + "; ".join(means))
    return notes


def _labels(result: Result) -> list[str]:
    return [axis for axis in (result.dataset.blocks, result.dataset.rows) if axis]


def _place(group: ScoreGroup, count: int) -> tuple[str, ...]:
    if group.block is None:
        return ("overall", "")[:count]
    return (str(group.block), "overall" if group.row is None else str(group.row))[:count]


def _rules(groups: Sequence[ScoreGroup]) -> frozenset[int]:
    """Return the rows followed by a line: the last of each block, or the one before the total."""
    blocks = [number for number, group in enumerate(groups) if group.row is None]
    several = any(group.row is not None for group in groups)
    return frozenset(blocks if several else blocks[-2:-1])


def all_tables(summary: RunSummary, store: Dataset | None) -> list[Table]:
    """Return a run's tables that are not empty: scores, extremes, times, by split and by scene.

    A limited run may have no whole split whose spread could be shown, and lack some scenes.

    Parameters
    ----------
    summary : RunSummary
        The run under a protocol.
    store : Dataset or None
        The data set, if available: its manifest names scenes and splits.
    """
    scenes, splits = (store.manifest.scenes, store.manifest.splits) if store else ([], [])
    tables = [run_score_table(summary, scenes), extremes_table(summary)]
    if summary.ranked and not summary.result.method.scored:
        tables.append(time_table(summary))
    tables += [spread_table(summary, splits), *scene_tables(summary, scenes)]
    return [table for table in tables if table.rows]


def scene_tables(summary: RunSummary, scenes: Sequence[Scene]) -> list[Table]:
    """Return a run's scores by geometry and by texture, like the thesis's Figs 7.2, 7.8 and 7.17.

    Parameters
    ----------
    summary : RunSummary
        The run under a protocol.
    scenes : sequence of Scene
        The manifest's scenes; if they name neither, there is no table.
    """
    return [_table(summary, what, label_of) for what, label_of in scene_labels(scenes).items()]


def spread_table(summary: RunSummary, splits: Sequence[Split] = ()) -> Table:
    """Return minimum, mean, maximum and deviation over pairs, like the thesis's Tables 7.3, 7.6.

    There is a row for the whole run, and for every split and partition within it. Table 7.3 is
    partition ``pruned`` in a run with ``--split all``; Table 7.6 is split ``test-pruned``.

    Parameters
    ----------
    summary : RunSummary
        The run under a protocol.
    splits : sequence of Split
        The manifest's splits.
    """
    result, protocol = summary.result, summary.protocol
    metrics = metrics_of(protocol)
    rows, rules, lacking = [], [], []
    for part, scenes in _parts(result, splits).items():
        (group,) = summarise_scenes(result, protocol, dict.fromkeys(scenes, part)).values()
        if group.evaluated < group.expected:
            lacking.append(part)
            continue
        for name, statistic in _SPREAD.items():
            first = (part, str(group.expected)) if name == "minimum" else ("", "")
            found = (getattr(group.metrics[metric], statistic) for metric in metrics)
            rows.append((*first, name, *map(score_text, found)))
        rules.append(len(rows) - 1)
    dataset = result.dataset
    title = (
        f"{result.method.title} on {dataset.label}, spread over pairs, "
        f"protocol {title_of(protocol)}"
    )
    columns = ("of", "pairs", "", *(metric.heading for metric in metrics.values()))
    notes = (f"not every pair was evaluated of {', '.join(lacking)}",) if lacking else ()
    return Table(title, columns, tuple(rows), "lrl", notes, frozenset(rules[:-1]))


def _parts(result: Result, splits: Sequence[Split]) -> dict[str, tuple[str, ...]]:
    whole = tuple(dict.fromkeys(pair.scene for pair in result.pairs))
    members: dict[str, tuple[str, ...]] = {}
    for split in splits:
        members[f"split {split.name}"] = tuple(split.scenes)
        partition = f"partition {split.partition}"
        members[partition] = (*members.get(partition, ()), *split.scenes)
    parts = {name: scenes for name, scenes in members.items() if set(scenes) < set(whole)}
    return {f"split {result.dataset.split}": whole, **parts}


def _table(summary: RunSummary, what: str, label_of: Mapping[str, str]) -> Table:
    result, protocol = summary.result, summary.protocol
    metrics = metrics_of(protocol)
    scenes = dict.fromkeys(pair.scene for pair in result.pairs)
    rows, idle = [], []
    for label, group in summarise_scenes(result, protocol, label_of).items():
        if not group.evaluated and not group.failed:
            idle.append(label)
            continue
        done = f"{group.evaluated}/{group.expected}"
        members = [scene for scene in scenes if label_of.get(scene) == label]
        rows.append((label, _listed(members), *_cells(group), done))
    notes = (f"nothing was run of {what} {', '.join(idle)}",) if idle else ()
    heads = [head for metric in metrics.values() for head in (metric.heading, "std")]
    dataset = result.dataset
    title = f"{result.method.title} on {dataset.heading}, by {what}, protocol {title_of(protocol)}"
    columns = (what, "scenes", *heads, "pairs")
    return Table(title, columns, tuple(rows), "ll", notes)


def _listed(names: list[str]) -> str:
    return " ".join(names) if len(names) <= 4 else f"{names[0]} … {names[-1]} ({len(names)})"


def _records(
    summary: RunSummary, labels: Mapping[str, Mapping[str, str]]
) -> Iterator[dict[str, object]]:
    """Yield a row for each group and metric; a label that does not define the group is ``all``."""
    axes, dataset = _labels(summary.result), summary.result.dataset
    run = {"method": summary.result.method.title, "dataset": dataset.name, "split": dataset.split}
    groups: list[tuple[dict[str, object], ScoreGroup]] = [
        (dict(zip(axes, (group.block, group.row), strict=False)), group) for group in summary.groups
    ]
    for what, label_of in labels.items():
        found = summarise_scenes(summary.result, summary.protocol, label_of)
        groups += [({what: label}, group) for label, group in found.items()]
    for place, group in groups:
        where = {name: place.get(name) for name in (*axes, *labels)}
        for metric, value in [*group.metrics.items(), ("seconds", group.seconds)]:
            yield {
                **{**run, "protocol": summary.protocol},
                **{name: "all" if at is None else at for name, at in where.items()},
                "metric": metric,
                **{"mean": value.mean, "std": value.std},
                **{"min": value.minimum, "max": value.maximum},
                **{"low": value.low, "high": value.high, "interval": value.interval_is},
                **{"defined": value.defined, "evaluated": group.evaluated},
                "expected": group.expected,
            }
