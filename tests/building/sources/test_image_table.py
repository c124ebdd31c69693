import pytest

from dfdbench.building.sources.image_table import read_table
from dfdbench.errors import SourceError


def test_cells_are_told_apart_by_the_first_line_s_mark() -> None:
    marked = b"image;note\n1;a, b", b"image\tnote\n1\ta, b"
    for text in (*marked, b'# by hand\n"image", "note"\n"1","a, b"'):
        assert read_table(text, "a.csv", []) == [{"image": "1", "note": "a, b"}]
    assert read_table(b'image  "note"\n1 "a b"', "a.txt", []) == [{"image": "1", "note": "a b"}]
    excel = b"\xef\xbb\xbfimage,note\n1,a; b"  # with a byte-order mark
    assert read_table(excel, "a.csv", []) == [{"image": "1", "note": "a; b"}]
    comma = b"image;focus\n2;1,2\n0,5;a, 1,2"
    assert [row["focus"] for row in read_table(comma, "a.csv", [])] == ["1.2", "a, 1,2"]
    for wrong in (b'image,note\n1,"' + b"a" * 200_000, b'image\tnote\n1\t"x\n2\ty'):
        with pytest.raises(SourceError, match="no table of the images"):
            read_table(wrong, "a.csv", [])


def test_json_holds_records_lists_or_values_by_file() -> None:
    records = b'[{"image": 3, "focus_distance": 0.5}]'
    assert read_table(records, "a.json", []) == [{"image": "3", "focus_distance": "0.5"}]
    assert read_table(records.replace(b"3", b"null"), "a.json", [])[0]["image"] == ""
    by_name = b'{"a.png": {"focus_distance": 2}}'
    assert read_table(by_name, "a.json", []) == [{"image": "a.png", "focus_distance": "2"}]
    exported = b'{"images": ["a.png"], "coordinates": {"focus_distance": [2.5]}}'
    assert read_table(exported, "a.json", []) == [{"images": "a.png", "focus_distance": "2.5"}]
    for wrong in (b"3", b"[3]", b"{", b"\xff"):
        with pytest.raises(SourceError, match=r"(?s)no table of the images.*mend the JSON"):
            read_table(wrong, "a.json", [])
