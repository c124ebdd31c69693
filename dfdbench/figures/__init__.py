"""Draw results, coverage, trainings, lenses and captures as figures."""
