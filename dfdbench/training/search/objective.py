"""What a search makes small, Eq. 6.1: the errors of a trained network on two sets of pairs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import torch
from torch import nn

from dfdbench.datasets.manifest import Pair
from dfdbench.datasets.store import Store
from dfdbench.methods.networks.inference import Predictor, Readout
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import Protocol, find_protocol, score
from dfdbench.training.scoring import same_threads

#: How much the training pairs count.
GAMMA = 0.3
#: What the objective is made of.
PARTS = ("nrmse", "nmae", "ssim")
#: What the thesis's author scores in his search: the centre of an image, divided by 255.
CENTRE = (368, 400)
_OF_CENTRE = Protocol(
    "search", 1, "all", "255", "whole", "the search published with the thesis's networks"
)


def objective(train: Mapping[str, float], other: Mapping[str, float], gamma: float) -> float:
    """Return Eq. 6.1: NMAE + NRMSE + 1 - SSIM, of two sets; infinite where one is not defined.

    Parameters
    ----------
    train, other : mapping
        Means of the three metrics on the training pairs, and on those that select.
    gamma : float
        The weight of the training pairs, 0 to 1.

    Examples
    --------
    >>> good, poor = dict(nrmse=0.1, nmae=0.1, ssim=0.8), dict(nrmse=0.2, nmae=0.2, ssim=0.4)
    >>> round(objective(good, poor, 0.3), 3), objective(good, {}, 0.3)
    (0.82, inf)
    """
    parts = [
        weight * (scores["nmae"] + scores["nrmse"] + 1 - scores["ssim"])
        for weight, scores in ((gamma, train), (1 - gamma, other))
        if all(math.isfinite(scores.get(name, math.nan)) for name in PARTS)
    ]
    return sum(parts) if len(parts) == 2 else math.inf


@same_threads()
def mean_parts(
    network: nn.Module,
    store: Store,
    pairs: Sequence[Pair],
    device: torch.device,
    readout: Readout,
    centre: bool,
) -> dict[str, float]:
    """Return the mean of each metric of the objective over pairs.

    Parameters
    ----------
    network : nn.Module
        In evaluation mode; its batch normalization is folded in place.
    store : Store
        Where the pairs lie.
    pairs : sequence of Pair
        Which pairs.
    device : torch.device
        Where it runs.
    readout : {"mode", "median"}
        Which level of a pixel's distribution is the answer.
    centre : bool
        Score the centre as the thesis's author does, else whole images under ``thesis``.
    """
    predict = Predictor(network, device, readout=readout)
    protocol = _OF_CENTRE if centre else find_protocol("thesis")
    values: dict[str, list[float]] = {name: [] for name in PARTS}
    for pair in pairs:
        images = store.read(pair)
        levels = predict(images.infocus, images.defocus).astype(np.float32)
        rows, columns = _seen(levels.shape, centre)
        depth, valid = images.depth[rows, columns], images.valid[rows, columns]
        scores = score(protocol, depth, valid, levels[rows, columns], store.manifest.network_crop)
        for name in PARTS:
            if not math.isnan(scores[name]):
                values[name].append(scores[name])
    means = {name: mean_of(found) for name, found in values.items()}
    return {name: mean for name, mean in means.items() if mean is not None}


def _seen(shape: tuple[int, ...], centre: bool) -> tuple[slice, slice]:
    if not centre:
        return slice(None), slice(None)
    starts = [max(0, (side - most) // 2) for side, most in zip(shape, CENTRE, strict=True)]
    rows, columns = (slice(s, s + most) for s, most in zip(starts, CENTRE, strict=True))
    return rows, columns
