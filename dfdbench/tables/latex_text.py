r"""Any text as LaTeX that pdflatex takes and that shows it as it is."""

from __future__ import annotations

import re
import unicodedata

_MARKS = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "$": r"\$",
    "&": r"\&",
    "#": r"\#",
    "%": r"\%",
    "_": r"\_",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "<": r"$<$",
    ">": r"$>$",
    "|": r"$|$",
    "[": "{[}",
    "]": "{]}",
    '"': "''",
    "↓": r"$\downarrow$",
    "↑": r"$\uparrow$",
    "–": "--",
    "—": "---",
    "−": "$-$",
    "×": r"$\times$",
    "±": r"$\pm$",
    "≤": r"$\le$",
    "≥": r"$\ge$",
    "°": r"$^\circ$",
    "²": r"$^2$",
    "³": r"$^3$",
    "δ": r"$\delta$",
    "…": r"\dots{}",
    "‘": "`",
    "’": "'",
    "“": "``",
    "”": "''",
}
_MINUS = re.compile(r"(?<![\w.])-(?=\.?\d)")
# What LaTeX's own fonts have besides letters with accents; of those the ogonek is lacking.
_LETTERS = "ßæœøłıÆŒØŁ"
_LAST_ACCENTED = "\u017e"
_OGONEK = "0328"
_LONGEST_LABEL = 60


def latex_text(text: str) -> str:
    r"""Return text as LaTeX; letters that its fonts lack are told by their number.

    Examples
    --------
    >>> print(latex_text("a_b: -0.5 to 50 %, 🐟"))
    a\_b: $-$0.5 to 50 \%, {[}U+1F41F{]}
    """
    return "".join(map(_letter, _MINUS.sub("−", text)))


def latex_label(text: str) -> str:
    """Return text as the name of a table, to be referred to; of a long one the first words.

    Examples
    --------
    >>> latex_label("demo-1, split test, protocol thesis")
    'tab:demo-1-split-test-protocol-thesis'
    """
    name = "-".join(re.findall(r"[a-z0-9]+", text.lower()))
    if len(name) > _LONGEST_LABEL:
        name = name[: _LONGEST_LABEL + 1].rpartition("-")[0] or name[:_LONGEST_LABEL]
    return f"tab:{name}"


def _letter(letter: str) -> str:
    if letter in _MARKS:
        return _MARKS[letter]
    category = unicodedata.category(letter)
    if category[0] in "CZ":
        return " "
    if letter.isascii() or letter in _LETTERS or _accented(letter):
        return letter
    return f"{{[}}U+{ord(letter):04X}{{]}}"


def _accented(letter: str) -> bool:
    parts = unicodedata.decomposition(letter).split()
    return (
        letter <= _LAST_ACCENTED and len(parts) == 2 and parts[0] < "0080" and parts[1] != _OGONEK
    )
