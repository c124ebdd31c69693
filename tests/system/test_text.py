"""JSON of others: what it says, or a ValueError."""

import pytest

from dfdbench.system.text import differences, parse_json, parse_toml


@pytest.mark.parametrize("text", ["{", "[" * 100_000, "9" * 5000, b"\xff\xfe\xff"])
def test_what_is_no_json_is_a_value_error(text: str | bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_json(text)


@pytest.mark.parametrize("text", ['{"a": 1, "a": 1}', '{"b": [{"a": 0.0, "c": 2, "a": 1}]}'])
def test_a_key_twice_is_refused_for_others_would_read_the_other(text: str) -> None:
    with pytest.raises(ValueError, match="the key 'a' twice"):
        parse_json(text)


@pytest.mark.parametrize("text", [r'{"a": ["\uDfff"]}', r'{"\ud83d": 1}', rb'"\ud800"'])
def test_half_a_character_is_no_text(text: str | bytes) -> None:
    with pytest.raises(ValueError, match="lone surrogate"):
        parse_json(text)
    assert parse_json(r'["\ud83d\ude00", "\\ud800"]') == ["\U0001f600", r"\ud800"]


def test_differences_are_named_at_any_depth_with_what_one_side_lacks() -> None:
    before = {"b": 1, "net": {"width": 8, "same": [1]}, "gone": True, "flat": {"x": 1}}
    now = {"b": 2, "net": {"width": 8, "same": [1], "new": 3}, "flat": 5}
    found = list(differences(before, now))
    assert found == [("b", 1, 2), ("net.new", None, 3), ("gone", True, None), ("flat", {"x": 1}, 5)]


def test_what_python_cannot_take_is_a_value_error() -> None:
    assert parse_toml("a = [1, 2]") == {"a": [1, 2]}
    with pytest.raises(ValueError, match="nested too deep"):
        parse_toml("a = " + "[" * 3000)
    with pytest.raises(ValueError, match="digits"):
        parse_toml("a = " + "1" * 5000)
