"""Raw files to a built set."""
