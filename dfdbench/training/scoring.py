"""The metrics of a network on some pairs, as training logs them."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from statistics import fmean

import numpy as np
import torch
from torch import nn

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Pair
from dfdbench.methods.networks.inference import Predictor, Readout
from dfdbench.metrics.metric import METRICS
from dfdbench.metrics.protocol import PROTOCOLS, find_protocol, score

#: Under which training scores are taken first, and drawn.
PROTOCOL = "thesis"
#: All under which they are taken: Tables 5.6 and 5.7 are of the second kind.
LOGGED = (PROTOCOL, find_protocol("thesis-networks").label)


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
    store: Dataset,
    pairs: Sequence[Pair],
    device: torch.device,
    readout: Readout = "mode",
) -> dict[str, dict[str, float]]:
    """Return the mean of each metric over pairs, under each protocol of `LOGGED`, by its label.

    A metric is absent where no pair defines it.

    Parameters
    ----------
    network : nn.Module
        Left as it is: a copy is asked.
    store : Dataset
        If the pairs lie.
    pairs : sequence of Pair
        Which pairs.
    device : torch.device
        If it runs.
    readout : {"mode", "median"}
        Which level of a pixel's distribution is the answer.
    """
    predict = Predictor(copy.deepcopy(network).eval(), device, readout=readout)
    values: dict[str, dict[str, list[float]]] = {
        protocol: {metric: [] for metric in METRICS} for protocol in LOGGED
    }
    for pair in pairs:
        images = store.read(pair)
        levels = predict(images.infocus, images.defocus).astype(np.float32)
        crop = store.manifest.network_crop
        for protocol, found in values.items():
            scores = score(PROTOCOLS[protocol], images.levels, images.valid, levels, crop)
            for metric in METRICS:
                if not math.isnan(scores[metric]):
                    found[metric].append(scores[metric])
    return {
        protocol: {metric: fmean(scores) for metric, scores in found.items() if scores}
        for protocol, found in values.items()
    }
