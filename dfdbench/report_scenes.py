"""Tables of a run by what its scenes show: the board's geometry, its texture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dfdbench.manifest import Scene
from dfdbench.protocol import METRICS, title_of
from dfdbench.result import Result
from dfdbench.summary import scene_labels, summarise_scenes
from dfdbench.tables import Table

_NOTHING = "–"


def scene_tables(result: Result, protocol: str, scenes: Sequence[Scene]) -> list[Table]:
    """Return a run's scores by geometry and by texture, as the thesis's Figs 7.2, 7.8 and 7.17.

    Parameters
    ----------
    result : Result
        The run.
    protocol : str
        Under which protocol.
    scenes : sequence of Scene
        Of the manifest; where they name neither, there is no table.
    """
    return [
        _table(result, protocol, what, label_of) for what, label_of in scene_labels(scenes).items()
    ]


def _table(result: Result, protocol: str, what: str, label_of: Mapping[str, str]) -> Table:
    members: dict[str, list[str]] = {}
    for pair in result.pairs:
        names = members.setdefault(label_of.get(pair.scene, _NOTHING), [])
        if pair.scene not in names:
            names.append(pair.scene)
    rows, idle = [], []
    for label, group in summarise_scenes(result, protocol, label_of).items():
        if not group.evaluated and not group.failed:
            idle.append(label)
            continue
        cells = [label, _listed(members[label])]
        for metric in METRICS:
            statistic = group.metrics[metric]
            cells += [_number(statistic.mean), _number(statistic.std)]
        rows.append((*cells, f"{group.evaluated}/{group.expected}"))
    notes = (f"nothing was run of {what} {', '.join(idle)}",) if idle else ()
    heads = [
        head
        for metric, up in METRICS.items()
        for head in (f"{metric.upper()} {'↑' if up else '↓'}", "std")
    ]
    dataset = result.dataset
    title = (
        f"{result.method.name} on {dataset.name}, split {dataset.split}, by {what}, "
        f"protocol {title_of(protocol)}"
    )
    columns = (what, "scenes", *heads, "pairs")
    return Table(title, columns, tuple(rows), "ll" + "r" * (len(columns) - 2), notes)


def _listed(names: list[str]) -> str:
    return " ".join(names) if len(names) <= 4 else f"{names[0]} … {names[-1]} ({len(names)})"


def _number(value: float | None) -> str:
    return _NOTHING if value is None else f"{value:.4f}"
