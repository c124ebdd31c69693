"""Scores, protocols, intervals."""

from dfdbench.metrics.scores import nmae, nrmse, ssim

__all__ = ["nmae", "nrmse", "ssim"]
