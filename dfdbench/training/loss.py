"""What training makes small: cross-entropy with the true depth level, or with those about it."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from dfdbench.blur.recipe import LEVELS
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
        # A row a pixel: channels come last in memory already, so that this copies nothing.
        rows = logits.float().permute(0, 2, 3, 1).reshape(-1, LEVELS)
        flat = levels.flatten()
        if self._targets is None:
            loss: Tensor = functional.cross_entropy(rows, flat, ignore_index=IGNORED)
            return loss
        if bool((flat == IGNORED).any()):
            known = flat != IGNORED
            rows, flat = rows[known], flat[known]
        crossed: Tensor = _CrossEntropy.apply(rows, self._targets, flat)  # type: ignore[no-untyped-call]
        level_loss: Tensor = crossed - self._entropy[flat].mean()
        return level_loss


class _CrossEntropy(torch.autograd.Function):
    # The gradient is softmax less target: taken at once, it costs a third of what autograd's
    # own steps through 256 levels a pixel do.
    @staticmethod
    def forward(ctx: Any, rows: Tensor, targets: Tensor, levels: Tensor) -> Tensor:
        chosen = targets.index_select(0, levels)
        logarithms = functional.log_softmax(rows, 1)
        loss = -torch.dot(logarithms.flatten(), chosen.flatten()) / len(rows)
        ctx.save_for_backward(logarithms.exp_().sub_(chosen).div_(len(rows)))
        return loss

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        (gradient,) = ctx.saved_tensors
        return gradient * gradients[0], None, None
