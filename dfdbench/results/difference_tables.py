"""Tables of a comparison: differences by lighting, the pairs that changed most."""

from __future__ import annotations

from dfdbench.errors import ResultError
from dfdbench.metrics.intervals import SCENES_TO_TELL, interval_name
from dfdbench.metrics.protocol import METRICS
from dfdbench.results.differences import PairChange, changes, check_comparable, paired_difference
from dfdbench.results.record import Result
from dfdbench.results.wording import method_label
from dfdbench.tables.table import Table


def change_tables(first: Result, second: Result, protocol: str, most: int = 10) -> list[Table]:
    """Return what changes from the first run to the second.

    Parameters
    ----------
    first, second : Result
        On the same data, split and protocol.
    protocol : str
        Under which protocol.
    most : int
        How many pairs are listed of those that changed most.

    Returns
    -------
    list of Table
        The differences and, where there are any, the pairs that changed.

    Raises
    ------
    ResultError
        Where the runs are not comparable, or no pair was evaluated by both.
    """
    check_comparable(first, second, protocol)
    if not any(changes(first, second, protocol, metric) for metric in METRICS):
        raise ResultError(
            "no pair was scored in both runs", fix="complete them: `dfdbench run` goes on"
        )
    tables = [difference_table(first, second, protocol)]
    if most_changed(first, second, protocol, most):
        tables.append(pair_table(first, second, protocol, most))
    return tables


def difference_table(first: Result, second: Result, protocol: str) -> Table:
    """Return the mean paired difference of each metric, and wins and losses by lighting."""
    dataset = first.dataset
    rows, records = [], []
    rules = set()
    for metric, up in METRICS.items():
        found = changes(first, second, protocol, metric)
        groups: list[tuple[str, tuple[PairChange, ...]]] = [("all", found)]
        for axis in (dataset.blocks, dataset.rows):
            for value in sorted({c.first.coordinates[axis] for c in found}) if axis else []:
                of_value = tuple(c for c in found if c.first.coordinates[axis or ""] == value)
                groups.append((f"{axis} {value}", of_value))
        for where, group in groups:
            difference = paired_difference(group, metric)
            if difference is None:
                continue
            head = f"{metric.upper()} {'↑' if up else '↓'}" if where == "all" else ""
            counts = (difference.wins, difference.losses, difference.ties)
            rows.append((head, where, str(difference), *map(str, counts)))
            records.append(
                {
                    "metric": metric,
                    "pairs": where,
                    "difference": difference.mean,
                    "low": difference.low,
                    "high": difference.high,
                    "wins": counts[0],
                    "losses": counts[1],
                    "ties": counts[2],
                    "verdict": difference.verdict,
                }
            )
        rules.add(len(rows) - 1)
    scenes = len({pair.scene for pair in first.pairs})
    columns = (
        "metric",
        "pairs",
        f"B less A, {interval_name(scenes)}",
        "B better",
        "B worse",
        "same",
    )
    names = [method_label(result.method) for result in (first, second)]
    title = f"A: {names[0]}, B: {names[1]}; {dataset.name}, split {dataset.split}, {protocol}"
    both = len(changes(first, second, protocol, "nmae"))
    notes = []
    if scenes >= SCENES_TO_TELL:
        notes.append("95 %: bootstrap over scenes of the pairs' differences. Real: leaves out 0.")
    elif scenes > 1:
        notes.append(
            f"{scenes} scenes: fewer than six are too few for a 95 % interval. Likely: all lean "
            "one way."
        )
    if both < dataset.expected:
        notes.append(f"{both} of {dataset.expected} pairs were scored in both runs")
    if _same_depth_maps(first, second):
        notes.append("The depth maps are the same in both runs, to the last digit.")
    return Table(
        title, columns, tuple(rows), "lllrrr", tuple(notes), frozenset(rules), tuple(records)
    )


def pair_table(first: Result, second: Result, protocol: str, most: int) -> Table:
    """Return the pairs whose NRMSE changed most, largest change first."""
    found = most_changed(first, second, protocol, most)
    rows = tuple(
        (
            change.first.id,
            f"{change.first.scores[protocol].nrmse:.4f}",
            f"{change.second.scores[protocol].nrmse:.4f}",
            f"{change.difference:+.4f}",
        )
        for change in found
    )
    records = tuple(
        {
            "pair": change.first.id,
            "a": change.first.scores[protocol].nrmse,
            "b": change.second.scores[protocol].nrmse,
            "difference": change.difference,
        }
        for change in found
    )
    return Table(
        "pairs that changed most in NRMSE",
        ("pair", "A", "B", "B less A"),
        rows,
        "lrrr",
        records=records,
    )


def most_changed(first: Result, second: Result, protocol: str, most: int) -> tuple[PairChange, ...]:
    """Return the pairs whose NRMSE changed most, largest change first; none that did not."""
    found = [c for c in changes(first, second, protocol, "nrmse") if c.difference]
    return tuple(sorted(found, key=lambda c: (-abs(c.difference), c.first.id))[:most])


def changes_to_show(
    first: Result, second: Result, protocol: str, count: int
) -> tuple[PairChange, ...]:
    """Return pairs whose NRMSE changed much, of as many scenes and views as there are.

    The pairs that changed most are often one scene's view under other lights, the same picture
    over and over: a pair counts behind those of scenes, then views, that were chosen less often.
    """
    axis = first.dataset.axes[0]
    left = list(most_changed(first, second, protocol, len(first.pairs)))
    chosen: list[PairChange] = []

    def seen(change: PairChange) -> tuple[int, int]:
        same_scene = [c for c in chosen if c.first.scene == change.first.scene]
        value = change.first.coordinates[axis]
        return len(same_scene), sum(c.first.coordinates[axis] == value for c in same_scene)

    while left and len(chosen) < count:
        chosen.append(left.pop(left.index(min(left, key=seen))))
    return tuple(sorted(chosen, key=lambda c: (-abs(c.difference), c.first.id)))


def _same_depth_maps(first: Result, second: Result) -> bool:
    others = {pair.id: pair.prediction_sha256 for pair in second.pairs if pair.status == "ok"}
    return all(
        pair.prediction_sha256 is not None and pair.prediction_sha256 == others[pair.id]
        for pair in first.pairs
        if pair.status == "ok" and pair.id in others
    )
