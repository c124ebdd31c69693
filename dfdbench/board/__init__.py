"""Rows of runs: submit, rank, verify and show them, with printed numbers beside them."""

from pathlib import Path

#: The leaderboard's folder in a clone.
LEADERBOARD = Path("leaderboard")
#: How far a score may be off if the depth map is not exactly the same: filters in float32 differ in
#: the last digits between processors.
SCORE_TOLERANCE = 1e-3
