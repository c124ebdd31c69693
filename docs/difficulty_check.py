"""Hold the errors of a run on a synthetic set against the difficulty of its pairs.

dfdbench build demo && dfdbench run --method local --dataset demo
python docs/difficulty_check.py demo results/demo-1-test/local
"""

import sys
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from dfdbench.audit.difficulty import STEPS, UNSEEN, smallest_step
from dfdbench.datasets.store import open_store
from dfdbench.results.folder import read_prediction
from dfdbench.results.record_file import RESULT, load_result


def main(dataset: str, folder: Path) -> None:
    """Print the rank correlation over pairs, then the mean error by smallest step seen."""
    store = open_store(dataset)
    assert store.recipe is not None
    split = load_result(folder / RESULT).dataset.split
    shares, coarse, means, steps, errors = [], [], [], [], []
    for pair in store.pairs(split):
        images = store.read(pair)
        prediction = read_prediction(folder, pair, store.shape_of(pair.scene))
        assert prediction is not None, f"no prediction of {pair.id}"
        found = smallest_step(images.infocus, images.depth, images.valid, store.recipe)
        error = np.abs(prediction - images.depth)[images.valid]
        shares.append(found.share_above(1))
        coarse.append(found.share_above(32))
        means.append(error.mean())
        steps.append(found.step[images.valid])
        errors.append(error)
    for step, values in ((1, shares), (32, coarse)):
        rank = spearmanr(values, means).statistic
        print(f"share above step {step} against mean error, {len(means)} pairs: rank {rank:.2f}")
    step, error = np.concatenate(steps), np.concatenate(errors)
    for value in (*STEPS, UNSEEN):
        chosen = step == value
        if chosen.any():
            name = "none" if value == UNSEEN else str(value)
            print(f"{name:>4}  {100 * chosen.mean():5.1f} %  {error[chosen].mean():.2f}")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
