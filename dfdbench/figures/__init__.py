"""Results, coverage, trainings, lenses and captures drawn as figures."""
