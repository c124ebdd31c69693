"""Rows of runs: submitted, ranked, verified, shown; printed numbers beside them."""

from pathlib import Path

#: The leaderboard's folder in a clone.
LEADERBOARD = Path("leaderboard")
