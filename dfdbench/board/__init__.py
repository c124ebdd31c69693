"""Rows of runs: submitted, ranked, verified, shown; printed numbers beside them."""
