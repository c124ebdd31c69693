"""The published JSON schemas of a result and of a comparison of depths."""
