"""The page and the Markdown that `dfdbench report` writes."""
