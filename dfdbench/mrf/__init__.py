"""Solvers for labelings of a grid with a cost per pixel and a cost per pair of neighbours."""

from dfdbench.mrf.energy import (
    Energy,
    Solution,
    adaptive_potts_weights,
    potts,
    published,
    truncated_absolute,
    truncated_quadratic,
)
from dfdbench.mrf.expansion import expansion
from dfdbench.mrf.split import Quality, split
from dfdbench.mrf.trws import lower_bound, message_passing

__all__ = [
    "Energy",
    "Quality",
    "Solution",
    "adaptive_potts_weights",
    "expansion",
    "lower_bound",
    "message_passing",
    "potts",
    "published",
    "split",
    "truncated_absolute",
    "truncated_quadratic",
]
