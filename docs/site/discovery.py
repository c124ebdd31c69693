"""What search engines, language models and previews read: descriptions, and `llms.txt`."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.nav import Navigation
from mkdocs.structure.pages import Page

_LONGEST = 160
_NO_PROSE = ("#", "|", "```", "<", "!", ":::", "- ", "* ", "*", "{")


def description_of(markdown: str) -> str:
    r"""Return the first paragraph of a page as plain text, at most 160 characters.

    Examples
    --------
    >>> description_of("# Tracks\n\nThe *same* [scenes](a.md), made `harder`.\n\nMore.")
    'The same scenes, made harder.'
    """
    for paragraph in re.split(r"\n\s*\n", re.sub(r"(?ms)^```.*?^```", "", markdown)):
        text = paragraph.strip()
        if text and not text.startswith(_NO_PROSE):
            plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
            plain = html.unescape(re.sub(r"[*`\\]", "", plain))
            return _shortened(" ".join(plain.split()))
    return ""


def _shortened(text: str) -> str:
    if len(text) <= _LONGEST:
        return text
    whole = text[: _LONGEST - 1]
    sentence = whole.rpartition(". ")[0]
    return f"{sentence}." if len(sentence) > _LONGEST / 2 else f"{whole.rpartition(' ')[0]}…"


def llms_text(config: MkDocsConfig, nav: Navigation) -> str:
    """Return `llms.txt`: every page of the navigation with its address and description."""
    parts = [f"# {config.site_name}\n", f"> {config.site_description}\n"]
    for item in nav.items:
        pages = [item] if isinstance(item, Page) else list(_pages(item))
        parts.append(f"## {item.title}\n")
        parts += [_line(page) for page in pages]
        parts.append("")
    return "\n".join(parts)


def _pages(section: object) -> Iterator[Page]:
    for child in getattr(section, "children", None) or ():
        if isinstance(child, Page):
            yield child
        else:
            yield from _pages(child)


def _line(page: Page) -> str:
    said = page.meta.get("description", "")
    address = page.canonical_url or page.url or "./"
    return f"- [{page.title}]({address})" + (f": {said}" if said else "")
