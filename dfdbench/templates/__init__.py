"""Templates of what the package writes."""
