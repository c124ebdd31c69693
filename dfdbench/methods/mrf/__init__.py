"""Solvers for labelings of a grid with a cost per pixel and a cost per pair of neighbours."""

from dfdbench.methods.mrf.blocks import coarse_to_fine
from dfdbench.methods.mrf.energy import Energy, Solution
from dfdbench.methods.mrf.expansion import expansion
from dfdbench.methods.mrf.repair import repair
from dfdbench.methods.mrf.smoothness import (
    adaptive_potts_weights,
    potts,
    published,
    truncated_absolute,
    truncated_quadratic,
)
from dfdbench.methods.mrf.split import Quality, split

__all__ = [
    "Energy",
    "Quality",
    "Solution",
    "adaptive_potts_weights",
    "coarse_to_fine",
    "expansion",
    "potts",
    "published",
    "repair",
    "split",
    "truncated_absolute",
    "truncated_quadratic",
]
