"""Solvers for labelings of a grid, with a cost per pixel and a cost per pair of neighbours."""

from dfdbench.methods.mrf.energy import (
    MOST_HELD,
    Energy,
    Parts,
    Solution,
    adaptive_potts_weights,
    potts,
    published,
    truncated_absolute,
    truncated_quadratic,
)
from dfdbench.methods.mrf.solvers import Quality, coarse_to_fine, expansion, repair, split

__all__ = ["MOST_HELD", "Energy", "Parts", "Quality", "Solution", "adaptive_potts_weights"]
__all__ += ["coarse_to_fine", "expansion", "potts", "published", "repair", "split"]
__all__ += ["truncated_absolute", "truncated_quadratic"]
