import io

from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from dfdbench.tables.render import as_rich
from dfdbench.tables.table import Table, as_html, least_width, without

WORDS = st.text("abc ", max_size=12)


@settings(max_examples=20)
@given(rows=st.lists(st.tuples(WORDS, WORDS, WORDS), max_size=4))
def test_no_word_and_no_number_is_broken(rows: list[tuple[str, str, str]]) -> None:
    table = Table("T", ("one", "two", "three"), tuple(rows), "lrl")
    inside = least_width(table) - 3 * 3 - 1
    numbers = max(len(row[1]) for row in [*rows, ("", "two", "")])
    words = [max(map(len, " ".join(row[at] for row in rows).split() or [""])) for at in (0, 2)]
    assert inside >= numbers + sum(words)
    whole = [max(len(row[at]) for row in [*rows, table.columns]) for at in range(3)]
    assert inside <= sum(whole)


def test_without_a_column_all_else_stays_in_its_place() -> None:
    table = Table("t", ("a", "std", "b", "std"), (("1", "2", "3", "4"),), "lrlr", ("note",))
    assert without(table, "std") == Table("t", ("a", "b"), (("1", "3"),), "ll", ("note",))


def test_a_notebook_shows_a_table_and_a_prompt_its_title() -> None:
    table = Table("T", ("a", "b"), (("1", "2"), ("3", "4")), "lr", records=({"a": 1},) * 1000)
    assert repr([table]) == "[<T: 2 rows>]"
    assert table._repr_html_() == as_html(table)


def test_names_are_whole_on_a_narrow_terminal() -> None:
    rows = (("realworld-synthetic", "448", "Real-world set k00-k63 with synthetic blur"),)
    table = without(Table("T", ("name", "pairs", ""), rows, "lrl"), "pairs")
    assert table.wraps == (False, True)
    written = io.StringIO()
    Console(file=written, width=least_width(table)).print(as_rich(table)[1])
    printed = written.getvalue()
    assert max(map(len, printed.splitlines())) == least_width(table) < 40
    assert all(word in printed.split() for word in " ".join((rows[0][0], rows[0][2])).split())
