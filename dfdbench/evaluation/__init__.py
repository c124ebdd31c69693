"""Run a method over a split: plan, evaluate pairs, record."""
