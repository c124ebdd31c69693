"""Where links lead on the site whose target in the repository is elsewhere."""

from __future__ import annotations

import posixpath
import re

#: Pages that are files of the repository, or parts of them, by where the site has them.
COPIED = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "LICENSE": "licence.md",
}
#: Files that have a page of another name here.
MOVED = {
    **COPIED,
    "leaderboard/README.md": "board/index.md",
    "docs/reference/datasets.md": "datasets/index.md",
}
_LINK = re.compile(r"(?<=\]\()([^)#:\s]*)(#[^)\s]*)?(?=\))")


def relinked(markdown: str, source: str, place: str) -> str:
    """Return a file's text with its links as they lead from its place on the site."""

    def lead(found: re.Match[str]) -> str:
        target, anchor = found[1], found[2] or ""
        if not target:
            return anchor
        wanted = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        there = _on_site(wanted)
        return posixpath.relpath(there, posixpath.dirname(place) or ".") + anchor

    # GitHub reads Markdown inside HTML as it is; here it has to be asked for.
    return _LINK.sub(lead, markdown).replace("<details>", "<details markdown>")


def _on_site(name: str) -> str:
    if name in MOVED:
        return MOVED[name]
    if name.startswith("leaderboard/results/"):
        return name.replace("leaderboard/", "board/", 1)
    # A notebook is a page there.
    return re.sub(r"\.ipynb$", ".md", name).removeprefix("docs/")
