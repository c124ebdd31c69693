"""How numbers read in tables."""

from __future__ import annotations


def percent(share: float) -> str:
    """Return a share as text; what is not nothing never reads 0.

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
