r"""Text that somebody else wrote, made fit to be shown: nothing in it steers a screen.

What cannot be seen is spelt out: control characters (an escape sequence moves the cursor), marks
of direction (they reorder what is read), and spaces of no width (two names look the same).
"""

from __future__ import annotations

import json
import unicodedata


def spelt_out(text: str) -> str:
    r"""Return text with the characters that cannot be seen as escapes; tabs and line ends stay.

    Examples
    --------
    >>> print(spelt_out("local\u200b \x1b[2J"))
    local\u200b \x1b[2J
    """
    return text if text.isprintable() else "".join(map(_spelt, text))


def spelt_out_json(text: str) -> str:
    r"""Return JSON that says the same, with the characters that cannot be seen as its escapes.

    Examples
    --------
    >>> print(spelt_out_json('{"name": "local\u200b"}'))
    {"name": "local\u200b"}
    """
    return "".join(c if _is_shown(c) else json.dumps(c)[1:-1] for c in text)


def _spelt(letter: str) -> str:
    return letter if _is_shown(letter) else letter.encode("unicode_escape").decode()


def _is_shown(letter: str) -> bool:
    return letter.isprintable() or letter in "\t\n" or unicodedata.category(letter) == "Zs"
