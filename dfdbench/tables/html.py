"""A table in HTML, for notebooks, whose own style it takes."""

from __future__ import annotations

from html import escape

from dfdbench.tables.table import Table


def as_html(table: Table) -> str:
    """Return a table as HTML, its title above and its notes below.

    Examples
    --------
    >>> text = as_html(Table("T", ("a", "n"), (("<x>", "1"),), "lr"))
    >>> "<b>T</b>" in text, "&lt;x&gt;" in text
    (True, True)
    """

    def line(tag: str, cells: tuple[str, ...]) -> str:
        sides = ("right" if side == "r" else "left" for side in table.align)
        return "".join(
            f'<{tag} style="text-align:{side}">{escape(cell)}</{tag}>'
            for cell, side in zip(cells, sides, strict=True)
        )

    body = "".join(f"<tr>{line('td', row)}</tr>" for row in table.rows)
    notes = "".join(f'<p style="font-size:smaller">{escape(note)}</p>' for note in table.notes)
    return (
        f"<p><b>{escape(table.title)}</b></p><table><thead><tr>{line('th', table.columns)}</tr>"
        f"</thead><tbody>{body}</tbody></table>{notes}"
    )
