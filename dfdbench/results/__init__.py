"""A run on disk: its record, means, differences, tables."""
