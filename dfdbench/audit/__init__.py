"""Is the test fair: depths, coverage, leaks, splits, difficulty."""
