"""What training makes small: cross-entropy with the true depth level, or with those about it."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from dfdbench.methods.networks import LEVELS
from dfdbench.training.crops import IGNORED


class LevelLoss:
    """Mean cross-entropy over the pixels.

    Parameters
    ----------
    width : float
        0: all weight on the true level, the published loss. Above: a Gaussian of this standard
        deviation in levels; its own entropy is taken off, so that 0 is a perfect answer.
    device : torch.device
        Of the tensors that it is called with.

    Examples
    --------
    >>> logits = torch.zeros(1, 256, 1, 1)
    >>> round(float(LevelLoss(0, torch.device("cpu"))(logits, torch.tensor([[[7]]]))), 4)
    5.5452
    """

    def __init__(self, width: float, device: torch.device) -> None:
        self._targets: Tensor | None = None
        if width:
            levels = torch.arange(LEVELS, dtype=torch.float32, device=device)
            weights = torch.exp(-(((levels[:, None] - levels) / width) ** 2) / 2)
            self._targets = weights / weights.sum(1, keepdim=True)
            self._entropy = torch.special.entr(self._targets).sum(1)

    def __call__(self, logits: Tensor, levels: Tensor) -> Tensor:
        """Return the loss for logits, float (n, 256, y, x), and levels, int64 (n, y, x)."""
        if self._targets is None:
            loss: Tensor = functional.cross_entropy(logits.float(), levels, ignore_index=IGNORED)
            return loss
        known = levels != IGNORED
        chosen = levels.clamp(min=0)
        logarithms = functional.log_softmax(logits.float(), 1)
        targets = self._targets[chosen].permute(0, 3, 1, 2)
        differences = -(targets * logarithms).sum(1) - self._entropy[chosen]
        mean: Tensor = differences[known].mean()
        return mean
