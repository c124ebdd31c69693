"""Compare the leaderboard's seeds with each other and with photographs: python docs/seeds.py.

Printed are each method's NRMSE on every seed's test rooms and on DFD indoor (protocol `valid`); how
many pairs of methods that one seed tells apart come in the other order on another; and the rank
correlation of seeds and photographs. A seed tells two methods apart as a ranking's words do: if
their difference over 24 rooms is beyond chance at 5 %, corrected for the number of pairs (Holm).
"""

from __future__ import annotations

from itertools import combinations, permutations
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

import dfdbench
from dfdbench.board.board import Board
from dfdbench.datasets.rendered import seeded
from dfdbench.metrics.intervals import LEVEL, chance, holm

ROOT = Path(__file__).parents[1]
PHOTOGRAPHS = "dfd-indoor-1"


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


def orders(errors: pd.DataFrame) -> dict[tuple[str, str], float]:
    """Return, of pairs of methods that are told apart, by how much the first is worse."""
    pairs = list(combinations(map(str, errors), 2))
    differences = [errors[one] - errors[other] for one, other in pairs]
    found = holm([chance(each.tolist(), each.index.tolist()) for each in differences])
    return {
        pair: float(each.mean())
        for pair, each, p in zip(pairs, differences, found, strict=True)
        if p is not None and p < LEVEL
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
    told = {name: orders(errors[name]) for name in seeds}
    held = [
        (pair, worse * told[other][pair] > 0)
        for one, other in permutations(seeds, 2)
        for pair, worse in told[one].items()
        if pair in told[other]
    ]
    turned = sorted({pair for pair, same in held if not same})
    pairs = len(list(combinations(means.index, 2)))
    apart = {name: len(found) for name, found in told.items()}
    print(
        f"\nOf {pairs} pairs of methods the seeds tell apart {', '.join(map(str, apart.values()))}."
    )
    mean = means[seeds].mean(axis=1)
    useful = [pair for pair in turned if mean[[*pair]].max() < mean["constant"]]
    print(f"Told apart by two seeds, but in other orders: {len(turned)}.")
    print(f"Of these, pairs of methods better than a constant: {len(useful)}.")
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
        found = rank_correlation(both)
        print(f"With {PHOTOGRAPHS}, over {len(both)} methods: {found:.2f}.")


def rank_correlation(two: pd.DataFrame) -> float:
    """Return Spearman's."""
    return float(stats.spearmanr(two.iloc[:, 0], two.iloc[:, 1]).statistic)


if __name__ == "__main__":
    main()
