from dfdbench.tables.html import as_html
from dfdbench.tables.table import Table


def test_cells_stand_under_their_headings_on_their_side_with_notes_below() -> None:
    text = as_html(Table("T & U", ("a", "n"), (("x", "1"), ("y", "2")), "lr", ("a note",)))
    assert "<b>T &amp; U</b>" in text
    assert text.count("<tr>") == 3
    assert '<td style="text-align:right">2</td>' in text
    assert text.index("</table>") < text.index("a note")
