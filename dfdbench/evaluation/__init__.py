"""A method over a split: plan, evaluate a pair, record."""
