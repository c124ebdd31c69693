"""Tables of a run by its scenes: the splits they are in, the board's geometry, its texture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dfdbench.datasets.manifest import Scene, Split
from dfdbench.metrics.protocol import metrics_of, title_of
from dfdbench.results.record import Result
from dfdbench.results.run_tables import run_tables
from dfdbench.results.summary import RunSummary, scene_labels, summarise_scenes
from dfdbench.results.wording import NOTHING, score_text
from dfdbench.tables.table import Table


def all_tables(
    summary: RunSummary, scenes: Sequence[Scene], splits: Sequence[Split]
) -> list[Table]:
    """Return all of a run's tables: its own, those of its splits and of its scenes; none is empty.

    Of a limited run there may be no whole split to tell the spread of, and no scene of a part.

    Parameters
    ----------
    summary : RunSummary
        The run under a protocol.
    scenes : sequence of Scene
        Of the manifest.
    splits : sequence of Split
        Of the manifest.
    """
    tables = [*run_tables(summary), spread_table(summary, splits), *scene_tables(summary, scenes)]
    return [table for table in tables if table.rows]


def scene_tables(summary: RunSummary, scenes: Sequence[Scene]) -> list[Table]:
    """Return a run's scores by geometry and by texture, as the thesis's Figs 7.2, 7.8 and 7.17.

    Parameters
    ----------
    summary : RunSummary
        The run under a protocol.
    scenes : sequence of Scene
        Of the manifest; where they name neither, there is no table.
    """
    return [_table(summary, what, label_of) for what, label_of in scene_labels(scenes).items()]


def spread_table(summary: RunSummary, splits: Sequence[Split] = ()) -> Table:
    """Return minimum, mean, maximum and deviation over the pairs, as the thesis's Tables 7.3, 7.6.

    Of the whole run, and of every split and partition that is a part of it: Table 7.3 is of
    partition ``pruned`` in a run with ``--split all``, Table 7.6 of split ``test-pruned``.

    Parameters
    ----------
    summary : RunSummary
        The run under a protocol.
    splits : sequence of Split
        Of the manifest.
    """
    result, protocol = summary.result, summary.protocol
    metrics = metrics_of(protocol)
    rows, rules, lacking = [], [], []
    for part, scenes in _parts(result, splits).items():
        (group,) = summarise_scenes(result, protocol, dict.fromkeys(scenes, part)).values()
        if group.evaluated < group.expected:
            lacking.append(part)
            continue
        for name, statistic in (
            ("minimum", "minimum"),
            ("mean", "mean"),
            ("maximum", "maximum"),
            ("std deviation", "std"),
        ):
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
    return Table(
        title, columns, tuple(rows), "lrl" + "r" * len(metrics), notes, frozenset(rules[:-1])
    )


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
    members: dict[str, list[str]] = {}
    for pair in result.pairs:
        names = members.setdefault(label_of.get(pair.scene, NOTHING), [])
        if pair.scene not in names:
            names.append(pair.scene)
    rows, idle = [], []
    for label, group in summarise_scenes(result, protocol, label_of).items():
        if not group.evaluated and not group.failed:
            idle.append(label)
            continue
        cells = [label, _listed(members[label])]
        for metric in metrics:
            statistic = group.metrics[metric]
            cells += [score_text(statistic.mean), score_text(statistic.std)]
        rows.append((*cells, f"{group.evaluated}/{group.expected}"))
    notes = (f"nothing was run of {what} {', '.join(idle)}",) if idle else ()
    heads = [head for metric in metrics.values() for head in (metric.heading, "std")]
    dataset = result.dataset
    title = (
        f"{result.method.title} on {dataset.label}, split {dataset.split}, by {what}, "
        f"protocol {title_of(protocol)}"
    )
    columns = (what, "scenes", *heads, "pairs")
    return Table(title, columns, tuple(rows), "ll" + "r" * (len(columns) - 2), notes)


def _listed(names: list[str]) -> str:
    return " ".join(names) if len(names) <= 4 else f"{names[0]} … {names[-1]} ({len(names)})"
