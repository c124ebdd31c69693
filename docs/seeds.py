"""Compare the leaderboard's seeds with each other and with photographs: python docs/seeds.py.

Printed are each method's NRMSE on every seed's test rooms and on DFD indoor (protocol `valid`); how
many pairs of methods come in one order on one seed and in the other on another; and the rank
correlation of seeds and photographs. Two methods have an order on a seed if their 95 % intervals do
not overlap, as ranks are made; or, which is so of more pairs, if their difference over 24 rooms is
beyond chance at 5 %, corrected for the number of pairs (Holm), as a ranking's words are made.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

import dfdbench
from dfdbench.board.board import Board
from dfdbench.datasets.rendered import seeded
from dfdbench.metrics.intervals import LEVEL, chance, group_interval, holm

ROOT = Path(__file__).parents[1]
PHOTOGRAPHS = "dfd-indoor-1"
#: By how much the first of two methods is worse, of pairs that have an order.
Orders = dict[tuple[str, str], float]


def errors_by_room(board: Board, family: str) -> dict[str, pd.DataFrame]:
    """Return NRMSE by data set: a row a scene, a column a method that ran on all of them."""
    kept = board.scores.query("protocol == 'valid' and metric == 'nrmse' and severity == 0")
    kept = kept[kept["split"] == "test"]
    frames = {}
    for name, rows in kept.groupby("dataset"):
        of_family = (seeded(str(name)) or ("", 0))[0] == family
        if of_family or name == PHOTOGRAPHS:
            frames[str(name)] = rows.pivot_table(index="scene", columns="method", values="value")
    shared = set.intersection(*(set(frame) for name, frame in frames.items() if seeded(name)))
    return {name: frame[[row for row in frame if row in shared]] for name, frame in frames.items()}


def ranked(errors: pd.DataFrame) -> Orders:
    """Return, of pairs of methods whose intervals are apart, by how much the first is worse."""
    of = {name: group_interval(errors[name].tolist(), errors.index.tolist()) for name in errors}
    return {
        (one, other): float(errors[one].mean() - errors[other].mean())
        for one, other in combinations(map(str, errors), 2)
        if (a := of[one]) and (b := of[other]) and (a[0] > b[1] or b[0] > a[1])
    }


def told_apart(errors: pd.DataFrame) -> Orders:
    """Return, of pairs of methods that are told apart, by how much the first is worse."""
    pairs = list(combinations(map(str, errors), 2))
    differences = [errors[one] - errors[other] for one, other in pairs]
    found = holm([chance(each.tolist(), each.index.tolist()) for each in differences])
    return {
        pair: float(each.mean())
        for pair, each, p in zip(pairs, differences, found, strict=True)
        if p is not None and p < LEVEL
    }


def turned(found: Sequence[Orders]) -> set[tuple[str, str]]:
    """Return the pairs of methods whose order is not the same on all seeds that have one."""
    return {
        pair
        for one, other in combinations(found, 2)
        for pair in one.keys() & other.keys()
        if one[pair] * other[pair] < 0
    }


def main(family: str = "unseen") -> None:
    """Print the table and what it says."""
    board = dfdbench.leaderboard(ROOT / "leaderboard")
    errors = errors_by_room(board, family)
    means = pd.DataFrame({name: frame.mean() for name, frame in errors.items()})
    seeds = [name for name in errors if seeded(name)]
    means = means.assign(mean=means[seeds].mean(axis=1)).sort_values("mean").drop(columns="mean")
    means = means[[*seeds, *means.columns.difference(seeds)]]
    print("| method | " + " | ".join(means.columns) + " |")
    print("|:---|" + "---:|" * len(means.columns))
    for method, values in means.iterrows():
        cells = ["–" if np.isnan(value) else f"{value:.4f}" for value in values]
        print(f"| {method} | " + " | ".join(cells) + " |")
    newest = [n for d in board.draws for n in seeds if (seeded(n) or ("", -1))[1] == d.seed][:3]
    pairs = len(list(combinations(means.index, 2)))
    mean = means[seeds].mean(axis=1)
    for words, order in (("whole intervals", ranked), ("differences", told_apart)):
        found = {name: order(errors[name]) for name in seeds}
        counts = ", ".join(str(len(each)) for each in found.values())
        print(f"\nBy {words} the seeds order {counts} of {pairs} pairs.")
        recently, ever = turned([found[name] for name in newest]), turned([*found.values()])
        useful = [pair for pair in ever if mean[[*pair]].max() < mean["constant"]]
        print(f"In two orders on the three newest seeds: {len(recently)}.")
        print(f"On any two: {len(ever)}, of which better than a constant are {len(useful)}.")
    print()
    late = [name for draw in board.draws for name, _ in board.late(draw)]
    print(
        f"Rows of another commit than the seed's: {', '.join(str(late.count(n)) for n in seeds)}."
    )
    for one, other in combinations(seeds, 2):
        print(
            f"Rank correlation of {one} and {other}: {rank_correlation(means[[one, other]]):.2f}."
        )
    if PHOTOGRAPHS in means:
        both = pd.DataFrame({"seeds": mean, "photographs": means[PHOTOGRAPHS]}).dropna()
        correlation = rank_correlation(both)
        print(f"With {PHOTOGRAPHS}, over {len(both)} methods: {correlation:.2f}.")


def rank_correlation(two: pd.DataFrame) -> float:
    """Return Spearman's."""
    return float(stats.spearmanr(two.iloc[:, 0], two.iloc[:, 1]).statistic)


if __name__ == "__main__":
    main()
