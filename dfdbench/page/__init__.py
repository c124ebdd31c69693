"""A report on runs as one page, in HTML or in Markdown with pictures."""
