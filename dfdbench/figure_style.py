"""What all figures of scores have in common: colours, markers, text as it stands."""

from __future__ import annotations

# Okabe and Ito's colours, which the colour-blind can tell apart; markers differ as well.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def plain_text(text: str) -> str:
    r"""Return text as matplotlib shows it letter by letter: no formulas, no hidden legends.

    Examples
    --------
    >>> plain_text("_a$b$")
    ' _a\\$b\\$'
    """
    text = " ".join(text.splitlines()).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text
