"""Hold the errors of a run on a synthetic set against the difficulty of its pairs.

dfdbench build demo && dfdbench run --method local --dataset demo
python docs/difficulty_check.py demo results/demo-1-test/local

Ranges of depth levels after the run, 36-39 or 56, are told apart from all other levels.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from dfdbench.audit.difficulty import STEPS, UNSEEN, smallest_step
from dfdbench.datasets.dataset import open_dataset
from dfdbench.results.record import RESULT, load_result
from dfdbench.results.run_folder import read_prediction


def main(dataset: str, folder: Path, *ranges: str) -> None:
    """Print the rank correlation over pairs, then the mean error by smallest step seen.

    Then, for each range of depth levels and for all others, the share of its pixels that cannot
    tell levels 32 apart, and its mean error.
    """
    store = open_dataset(dataset)
    assert store.recipe is not None
    split = load_result(folder / RESULT).dataset.split
    shares, coarse, means, steps, errors, depths = [], [], [], [], [], []
    for pair in store.pairs(split):
        images = store.read(pair)
        prediction = read_prediction(folder, pair, store.shape_of(pair.scene))
        assert prediction is not None, f"no prediction of {pair.id}"
        found = smallest_step(images.infocus, images.levels, images.valid, store.recipe)
        error = np.abs(prediction - images.levels)[images.valid]
        shares.append(found.share_above(1))
        coarse.append(found.share_above(32))
        means.append(error.mean())
        steps.append(found.step[images.valid])
        errors.append(error)
        depths.append(images.levels[images.valid])
    for bound, values in ((1, shares), (32, coarse)):
        rank = spearmanr(values, means).statistic
        print(f"share above step {bound} against mean error, {len(means)} pairs: rank {rank:.2f}")
    step, error = np.concatenate(steps), np.concatenate(errors)
    for value in (*STEPS, UNSEEN):
        chosen = step == value
        if chosen.any():
            name = "none" if value == UNSEEN else str(value)
            print(f"{name:>4}  {100 * chosen.mean():5.1f} %  {error[chosen].mean():.2f}")
    depth, others = np.concatenate(depths), np.ones(error.shape, bool)
    for name in ranges:
        first, _, last = name.partition("-")
        inside = (depth >= int(first)) & (depth <= int(last or first))
        others &= ~inside
        print_levels(name, inside, step, error)
    if ranges:
        print_levels("others", others, step, error)


def print_levels(
    name: str, inside: NDArray[np.bool_], step: NDArray[np.int64], error: NDArray[np.float64]
) -> None:
    """Print what share of the pixels inside cannot tell levels 32 apart, and their mean error."""
    share = 100 * (step[inside] > 32).mean()
    print(f"levels {name:>7}  {share:5.1f} % above step 32  {error[inside].mean():.2f}")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), *sys.argv[3:])
