"""The differences between two runs, pair by pair, and the tables that show them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

from dfdbench.errors import Problem, ResultError
from dfdbench.metrics import intervals
from dfdbench.metrics.metric import find_metric, mean_of
from dfdbench.metrics.protocol import SURE, label_of, metrics_of, ranked_by, require_scored
from dfdbench.results.record import PairResult, Result
from dfdbench.results.wording import method_label, score_text
from dfdbench.tables.table import Table

#: The verdict on a difference over fewer groups of scenes than `GROUPS_TO_TELL`.
TOO_FEW = "too few scenes to tell"


@dataclass(frozen=True)
class PairChange:
    """One pair in both runs; `difference` is the second run's score minus the first's."""

    first: PairResult
    second: PairResult
    difference: float


@dataclass(frozen=True)
class PairedDifference:
    """The mean of paired differences in one metric.

    Parameters
    ----------
    mean : float
        The second run's score minus the first's.
    low, high : float or None
        From `dfdbench.metrics.intervals.group_interval`.
    wins, losses, ties : int
        The number of pairs on which the second run is better, worse, or the same.
    groups : int
        The number of groups of scenes that the pairs belong to.
    p : float or None
        From `dfdbench.metrics.intervals.chance`; in a table, after Holm's correction.
    """

    mean: float
    low: float | None
    high: float | None
    wins: int
    losses: int
    ties: int
    groups: int
    p: float | None

    def __str__(self) -> str:
        text = f"{self.mean:+.4f}"
        if self.low is not None and self.high is not None:
            text += f" ({self.low:+.4f} to {self.high:+.4f})"
        return f"{text}, {self.verdict}"

    @property
    def verdict(self) -> str:
        """Whether the difference is more than chance.

        ``real`` if `p` is below 5 %, else ``may be chance``. Below ten groups there is no verdict.
        If no pair differs, there is no difference.
        """
        if not self.wins + self.losses:
            return "none"
        if self.groups < intervals.GROUPS_TO_TELL or self.p is None:
            return TOO_FEW
        return "real" if self.p < intervals.LEVEL else "may be chance"


def verdict_note(groups: int) -> str:
    """Return what the verdicts mean in a table of differences over this many groups of scenes."""
    over = f"{groups} groups of scenes (those of one family or room are one)"
    if groups >= intervals.GROUPS_TO_TELL:
        return (
            f"95 %: interval over {over}. Real: chance alone would make such a difference in under "
            "5 % of cases, after Holm's correction for the number of differences shown."
        )
    few = f"Fewer than {intervals.GROUPS_TO_TELL} are too few to tell a difference from chance"
    if groups >= intervals.INTERVAL_GROUPS:
        return f"95 %: interval over {over}. {few}."
    return (
        f"Range of group means: the lowest and the highest over {over}. {few}, and fewer than "
        f"{intervals.INTERVAL_GROUPS} for an interval."
    )


def check_comparable(first: Result, second: Result, protocol: str) -> None:
    """Raise if two runs must not be compared.

    Raises
    ------
    ResultError
        If data, split or the protocol's definition differ.
    UnknownNameError
        If one of them was not scored under that protocol.
    """
    one, other = (result.dataset.model_dump() for result in (first, second))
    what = "runs on different data are not comparable"
    fix = "run both methods on the same built data set and split"
    # The hashes of two data sets are another's, too.
    hashes = ("manifest_sha256", "fingerprint") * (one["name"] == other["name"])
    ResultError.raise_if(
        Problem(f"{what}: {one[fact]} and {other[fact]}", where=f"dataset.{fact}", fix=fix)
        for fact in ("name", *hashes, "split")
        if one[fact] != other[fact]
    )
    definitions = []
    for result in (first, second):
        require_scored(protocol, result.protocol_names, f"{result.method.name}'s result")
        definitions += [known for known in result.protocols if label_of(known) == protocol]
    if definitions[0] != definitions[1]:
        what = f"protocol {protocol} is defined differently in the two results"
        raise ResultError(what, fix="run both with the same version")


def changes(first: Result, second: Result, protocol: str, metric: str) -> tuple[PairChange, ...]:
    """Return the change of each pair that both runs evaluated and that has the metric."""
    found, about = [], find_metric(metric)
    for pair, other in _in_both(first, second):
        before, after = pair.score(protocol, metric), other.score(protocol, metric)
        if before is not None and after is not None:
            change = about.compared(after) - about.compared(before)
            found.append(PairChange(pair, other, change))
    return tuple(found)


def _in_both(first: Result, second: Result) -> list[tuple[PairResult, PairResult]]:
    others = {pair.id: pair for pair in second.evaluated}
    return [(pair, others[pair.id]) for pair in first.evaluated if pair.id in others]


def paired_difference(
    values: Sequence[float], groups: Sequence[str], metric: str
) -> PairedDifference | None:
    """Return mean, interval, wins and losses of some differences; None if there are none.

    Parameters
    ----------
    values : sequence of float
        The second run's score minus the first's, one per pair.
    groups : sequence of str
        The group of scenes of each pair.
    metric : str
        The metric, which says whether larger is better.
    """
    mean = mean_of(values)
    if mean is None:
        return None
    better = sum(value > 0 for value in values)
    worse = sum(value < 0 for value in values)
    if not find_metric(metric).larger_is_better:
        better, worse = worse, better
    low, high = intervals.group_interval(values, groups) or (None, None)
    ties = len(values) - better - worse
    count, p = len(set(groups)), intervals.chance(values, groups)
    return PairedDifference(mean, low, high, better, worse, ties, count, p)


def corrected(table: Sequence[PairedDifference | None]) -> list[PairedDifference | None]:
    """Return a table's differences with their `p` corrected for their number (Holm)."""
    chances = intervals.holm([None if difference is None else difference.p for difference in table])
    return [each and replace(each, p=p) for each, p in zip(table, chances, strict=True)]


_ALL = "all"


def change_tables(
    first: Result,
    second: Result,
    protocol: str,
    most: int = 10,
    names: Sequence[str] = (),
    beside: Sequence[PairedDifference | None] = (),
) -> list[Table]:
    """Return tables of what changes from the first run to the second.

    Parameters
    ----------
    first, second : Result
        Runs on the same data and split, scored under the same protocol.
    protocol : str
        The protocol.
    most : int
        How many of the pairs that changed most to list.
    names : tuple of str, optional
        The names of the two runs; by default their methods' labels.
    beside : sequence of PairedDifference, optional
        What the first run's `paired_differences` from other runs are, shown beside these: Holm's
        correction counts them, too.

    Returns
    -------
    list of Table
        The differences and, if there are any, the pairs that changed.

    Raises
    ------
    ResultError
        If the runs are not comparable, or no pair was evaluated in both.
    """
    found = paired_differences(first, second, protocol)
    if not any(found.values()):
        fix = "`dfdbench run` goes on"
        if any(pair.lacks_answers(protocol) for pair in (*first.evaluated, *second.evaluated)):
            both = all(SURE in result.protocol_names for result in (first, second))
            fix = "compare by --protocol sure, or answer them all" if both else "answer them all"
            fix = f"pixels are without an answer: {fix}"
        raise ResultError("no pair was scored in both runs", fix=fix)
    tables = (
        difference_table(first, second, protocol, found, names, beside),
        pair_table(first, second, protocol, most),
    )
    return [table for table in tables if table.rows]


def paired_differences(
    first: Result, second: Result, protocol: str
) -> dict[tuple[str, str], PairedDifference | None]:
    """Return the differences from one run to another by metric and pairs, not yet corrected.

    Raises
    ------
    ResultError
        If the runs are not comparable.
    """
    check_comparable(first, second, protocol)
    found = {}
    for name in metrics_of(protocol):
        for where, part in _parted(changes(first, second, protocol, name), first):
            groups = [first.dataset.group_of(change.first.scene) for change in part]
            values = [change.difference for change in part]
            found[name, where] = paired_difference(values, groups, name)
    return found


def difference_table(
    first: Result,
    second: Result,
    protocol: str,
    found: Mapping[tuple[str, str], PairedDifference | None],
    names: Sequence[str],
    beside: Sequence[PairedDifference | None],
) -> Table:
    """Return the mean paired difference of each metric, and wins and losses by lighting."""
    dataset = first.dataset
    rows, records = [], []
    every = corrected([*found.values(), *beside])
    for (name, where), difference in zip(found, every, strict=False):
        if difference is not None:
            counts = (difference.wins, difference.losses, difference.ties)
            head = find_metric(name).heading if where == _ALL else ""
            rows.append((head, where, str(difference), *map(str, counts)))
            records.append({"metric": name, "pairs": where, **_as_record(difference)})
    compared = changes(first, second, protocol, ranked_by(protocol)[0])
    count = len({dataset.group_of(change.first.scene) for change in compared})
    named = intervals.interval_name(count)
    notes = [verdict_note(count)] * (count > 1)
    others = [
        f"{find_metric(name).title}, {where}"
        for (name, where), one in found.items()
        if one and one.low is not None and intervals.interval_name(one.groups) != named
    ]
    if others:
        kind = (
            "the range of group means" if count >= intervals.INTERVAL_GROUPS else "a 95 % interval"
        )
        notes.append(f"over another number of groups, so {kind}: {'; '.join(others)}")
    aims = [about for about in metrics_of(protocol).values() if about.best is not None]
    notes += [f"{one.title}: how much farther from {one.best:g} B is than A" for one in aims]
    if len(compared) < dataset.expected:
        notes.append(f"{len(compared)} of {dataset.expected} pairs were scored in both runs")
    hashes = [(a.prediction_sha256, b.prediction_sha256) for a, b in _in_both(first, second)]
    if all(one and one == other for one, other in hashes):
        notes.append("The depth maps are the same in both runs, to the last digit.")
    a, b = names or (method_label(first.method), method_label(second.method))
    title = f"A: {a}, B: {b}; {dataset.heading}, {protocol}"
    columns = ("metric", "pairs", f"B minus A, {named}", "B better", "B worse", "same")
    rules = frozenset(before for before, row in enumerate(rows, -1) if row[0])
    return Table(title, columns, tuple(rows), "lllrrr", tuple(notes), rules, tuple(records))


def _parted(found: tuple[PairChange, ...], run: Result) -> list[tuple[str, tuple[PairChange, ...]]]:
    groups = [(_ALL, found)]
    for axis in filter(None, (run.dataset.blocks, run.dataset.rows)):
        values = sorted({c.first.coordinates[axis] for c in found})
        for value in values if len(values) > 1 else []:
            of_value = tuple(c for c in found if c.first.coordinates[axis] == value)
            groups.append((f"{axis} {value}", of_value))
    return groups


def _as_record(difference: PairedDifference) -> dict[str, object]:
    values = asdict(difference)
    del values["groups"]
    return {"difference": values.pop("mean"), **values, "verdict": difference.verdict}


def pair_table(first: Result, second: Result, protocol: str, most: int) -> Table:
    """Return the pairs whose NRMSE (AbsRel in metres) changed most, largest change first."""
    metric = ranked_by(protocol)[0]
    rows, records = [], []
    for change in most_changed(first, second, protocol, most):
        pair, by = change.first.id, change.difference
        a, b = (each.score(protocol, metric) for each in (change.first, change.second))
        rows.append((pair, score_text(a), score_text(b), f"{by:+.4f}"))
        records.append({"pair": pair, "a": a, "b": b, "difference": by})
    title = f"pairs that changed most in {find_metric(metric).title}"
    columns = ("pair", "A", "B", "B minus A")
    return Table(title, columns, tuple(rows), "lrrr", records=tuple(records))


def most_changed(first: Result, second: Result, protocol: str, most: int) -> tuple[PairChange, ...]:
    """Return the pairs whose ranking score changed most, largest change first."""
    found = [c for c in changes(first, second, protocol, ranked_by(protocol)[0]) if c.difference]
    return tuple(sorted(found, key=lambda c: (-abs(c.difference), c.first.id))[:most])


def changes_to_show(
    first: Result, second: Result, protocol: str, count: int
) -> tuple[PairChange, ...]:
    """Return pairs whose ranking score changed much, from as many scenes and views as possible.

    The pairs that changed most often show one view of one scene under several lights, the same
    picture over and over. So pairs of scenes, then views, that were chosen less often come first.
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
