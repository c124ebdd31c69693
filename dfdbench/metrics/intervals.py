"""How sure a mean is: intervals bootstrapped over scenes."""

from collections.abc import Sequence

import numpy as np

#: That n scenes all lean one way by chance has probability 2 / 2^n: below 5 % from 6 on. With
#: fewer, a bootstrap over scenes is narrower than its 95 % say.
SCENES_TO_TELL = 6
_RESAMPLES = 2000


def interval_name(scenes: int) -> str:
    """Return what `scene_interval` gives for so many scenes, as a column's heading.

    Examples
    --------
    >>> interval_name(6), interval_name(3)
    ('95 %', 'range of scene means')
    """
    return "95 %" if scenes >= SCENES_TO_TELL else "range of scene means"


def scene_interval(
    values: Sequence[float], scenes: Sequence[str], seed: int = 0
) -> tuple[float, float] | None:
    """Return the 95 % interval of the mean or, of fewer than six scenes, their means' range.

    Parameters
    ----------
    values : sequence of float
        One a pair.
    scenes : sequence of str
        The scene of each.
    seed : int
        Of the resampling.

    Returns
    -------
    tuple of float, or None
        None if there is only one scene.

    Examples
    --------
    >>> scene_interval([1.0, 2.0, 3.0, 5.0], ["a", "a", "b", "b"])
    (1.5, 4.0)
    """
    names = sorted(set(scenes))
    if len(names) >= SCENES_TO_TELL:
        return bootstrap_interval(values, scenes, seed)
    if len(names) < 2:
        return None
    by_scene = [[v for v, s in zip(values, scenes, strict=True) if s == name] for name in names]
    means = [float(np.mean(of_scene)) for of_scene in by_scene]
    return min(means), max(means)


def bootstrap_interval(
    values: Sequence[float], scenes: Sequence[str], seed: int = 0
) -> tuple[float, float] | None:
    """Return the 95 % interval of the mean, resampling whole scenes.

    Pairs of a scene share their depth map and are not independent, so scenes are drawn, with
    replacement, not pairs. Parameters and answer are those of `scene_interval`, which asks this
    where there are scenes enough.

    Examples
    --------
    >>> bootstrap_interval([1.0, 1.0, 3.0, 3.0], ["a", "a", "b", "b"])
    (1.0, 3.0)
    """
    names, place = np.unique(np.asarray(scenes), return_inverse=True)
    if len(names) < 2:
        return None
    totals = np.bincount(place, weights=np.asarray(values))
    counts = np.bincount(place)
    draws = np.random.default_rng(seed).integers(0, len(names), (_RESAMPLES, len(names)))
    means = totals[draws].sum(axis=1) / counts[draws].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)
