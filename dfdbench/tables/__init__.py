"""One table, in five forms."""
