"""The metrics of a network on some pairs, as training logs them."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import torch
from torch import nn

from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.store import Store
from dfdbench.methods.networks.inference import Predictor, Readout
from dfdbench.metrics.metric import METRICS, mean_of
from dfdbench.metrics.protocol import PROTOCOLS, score

#: Under which training scores are taken.
PROTOCOL = "thesis"


def evenly_spaced(pairs: Sequence[Pair], count: int) -> tuple[Pair, ...]:
    """Return some of the pairs, spread over all of them.

    Examples
    --------
    >>> evenly_spaced("abcdef", 3)
    ('a', 'c', 'e')
    """
    count = min(count, len(pairs))
    return tuple(pairs[index * len(pairs) // count] for index in range(count))


@contextmanager
def same_threads() -> Iterator[None]:
    """Leave PyTorch as many threads after the block as before.

    Numba shares OpenMP with PyTorch, and leaves its own number of threads behind.
    """
    threads = torch.get_num_threads()
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@same_threads()
def mean_scores(
    network: nn.Module,
    store: Store,
    pairs: Sequence[Pair],
    device: torch.device,
    on_pair: Callable[[int, int], None] | None = None,
    readout: Readout = "mode",
) -> dict[str, float]:
    """Return the mean of each metric over pairs; a metric is absent where no pair defines it.

    Parameters
    ----------
    network : nn.Module
        Left as it is: a copy is asked.
    store : Store
        Where the pairs lie.
    pairs : sequence of Pair
        Which pairs.
    device : torch.device
        Where it runs.
    on_pair : callable, optional
        Called with (pairs done, pairs to do).
    readout : {"mode", "median"}
        Which level of a pixel's distribution is the answer.
    """
    predict = Predictor(copy.deepcopy(network).eval(), device, readout=readout)
    values: dict[str, list[float]] = {metric: [] for metric in METRICS}
    for done, pair in enumerate(pairs, 1):
        images = store.read(pair)
        levels = predict(images.infocus, images.defocus).astype(np.float32)
        scores = score(
            PROTOCOLS[PROTOCOL], images.depth, images.valid, levels, store.manifest.network_crop
        )
        for metric in METRICS:
            value = scores[metric]
            if not math.isnan(value):
                values[metric].append(value)
        if on_pair:
            on_pair(done, len(pairs))
    means = {metric: mean_of(found) for metric, found in values.items()}
    return {metric: mean for metric, mean in means.items() if mean is not None}
