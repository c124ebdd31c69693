"""Check whether a test is fair: depths, coverage, leaks, splits, difficulty."""
