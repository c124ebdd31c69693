"""Paired differences between two runs: pair by pair, with an interval over scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dfdbench.errors import Problem, ResultError
from dfdbench.metrics.intervals import SCENES_TO_TELL, scene_interval
from dfdbench.metrics.metric import find_metric, mean_of
from dfdbench.metrics.protocol import label_of, require_scored
from dfdbench.results.record import PairResult, Result

#: The verdict on a difference over fewer scenes than `SCENES_TO_TELL`.
TOO_FEW = "too few scenes to tell"


@dataclass(frozen=True)
class PairChange:
    """One pair under both runs; `difference` is the second run's score less the first's."""

    first: PairResult
    second: PairResult
    difference: float


@dataclass(frozen=True)
class PairedDifference:
    """The mean of paired differences in one metric.

    Parameters
    ----------
    mean : float
        Second run less first.
    low, high : float or None
        95 % interval or, of fewer than six scenes, the range of their means; None for one scene.
    wins, losses, ties : int
        Pairs on which the second run is better, worse, the same.
    scenes : int
        How many scenes the pairs are of.
    """

    mean: float
    low: float | None
    high: float | None
    wins: int
    losses: int
    ties: int
    scenes: int

    def __str__(self) -> str:
        text = f"{self.mean:+.4f}"
        if self.low is not None and self.high is not None:
            text += f" ({self.low:+.4f} to {self.high:+.4f})"
        return f"{text}, {self.verdict}"

    @property
    def verdict(self) -> str:
        """Whether the difference is more than chance.

        ``real`` if the 95 % interval excludes 0, else ``may be chance``. Below six scenes there is
        no interval and no verdict: three scenes all lean one way by chance one time in four.
        """
        if self.scenes < SCENES_TO_TELL or self.low is None or self.high is None:
            return TOO_FEW
        return "may be chance" if self.low <= 0 <= self.high else "real"


def check_comparable(first: Result, second: Result, protocol: str) -> None:
    """Refuse two runs that must not be compared.

    Raises
    ------
    ResultError
        Where data, split or the protocol's definition differ.
    UnknownNameError
        Where one of them was not scored under that protocol.
    """
    problems = []
    for what in ("name", "manifest_sha256", "fingerprint", "split"):
        values = [str(getattr(result.dataset, what)) for result in (first, second)]
        if values[0] != values[1]:
            problems.append(
                Problem(
                    "runs on different data are not comparable",
                    where=f"dataset.{what}",
                    expected=values[0],
                    got=values[1],
                    fix="run both methods on the same built data set and split",
                )
            )
    if problems:
        raise ResultError.of(problems)
    definitions = []
    for result in (first, second):
        require_scored(protocol, result.protocol_names, f"{result.method.name}'s result")
        definitions += [known for known in result.protocols if label_of(known) == protocol]
    if definitions[0] != definitions[1]:
        raise ResultError(
            f"protocol {protocol} is defined differently in the two results",
            where="",
            expected=str(definitions[0]),
            got=str(definitions[1]),
            fix="run both with the same version",
        )


def changes(first: Result, second: Result, protocol: str, metric: str) -> tuple[PairChange, ...]:
    """Return the change of each pair that both runs evaluated and for which the metric exists."""
    others = {pair.id: pair for pair in second.pairs if pair.status == "ok"}
    found = []
    for pair in first.pairs:
        other = others.get(pair.id)
        if pair.status != "ok" or other is None:
            continue
        before, after = pair.score(protocol, metric), other.score(protocol, metric)
        if before is not None and after is not None:
            found.append(PairChange(pair, other, after - before))
    return tuple(found)


def paired_difference(
    values: Sequence[float], scenes: Sequence[str], metric: str, seed: int = 0
) -> PairedDifference | None:
    """Return mean, interval, wins and losses of some differences; None where there are none.

    Parameters
    ----------
    values : sequence of float
        The second run's score less the first's, one a pair.
    scenes : sequence of str
        The scene of each.
    metric : str
        Which metric they are of: it says whether larger is better.
    seed : int
        Of the bootstrap.
    """
    mean = mean_of(values)
    if mean is None:
        return None
    better = sum(value > 0 for value in values)
    worse = sum(value < 0 for value in values)
    if not find_metric(metric).larger_is_better:
        better, worse = worse, better
    low, high = scene_interval(values, scenes, seed) or (None, None)
    ties = len(values) - better - worse
    return PairedDifference(mean, low, high, better, worse, ties, len(set(scenes)))
