"""How numbers and lists are worded, in tables and messages."""

from __future__ import annotations

from collections.abc import Iterable


def percent(share: float) -> str:
    """Format a share as a percentage; a non-zero share never prints as 0 %.

    Examples
    --------
    >>> percent(0.1234), percent(0), percent(2e-6)
    ('12.3 %', '0 %', '0.0002 %')
    """
    if share == 0:
        return "0 %"
    if share >= 0.001:
        return f"{100 * share:.1f} %"
    digits = f"{100 * share:.1g}"
    return f"{float(digits):f}".rstrip("0").rstrip(".") + " %" if share >= 1e-8 else "< 0.000001 %"


def counted(number: int, what: str) -> str:
    """Format a number of things.

    Examples
    --------
    >>> counted(1, "pair"), counted(0, "pair"), counted(1234, "scene")
    ('1 pair', '0 pairs', '1234 scenes')
    """
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def listed(things: Iterable[object], most: int | None = None) -> str:
    """Join things with commas; of more than `most`, name the first and count the rest.

    Examples
    --------
    >>> listed(["Art", "Books", "Dolls"]), listed(["Art", "Books", "Dolls"], most=2)
    ('Art, Books, Dolls', 'Art, Books and 1 more')
    """
    texts = [str(thing) for thing in things]
    left = 0 if most is None else len(texts) - most
    return ", ".join(texts[:most]) + (f" and {left} more" if left > 0 else "")
