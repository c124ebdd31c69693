import pytest

from dfdbench.system.toml_text import parse_toml


def test_what_python_cannot_take_is_a_value_error() -> None:
    assert parse_toml("a = [1, 2]") == {"a": [1, 2]}
    with pytest.raises(ValueError, match="nested too deep"):
        parse_toml("a = " + "[" * 3000)
    with pytest.raises(ValueError, match="digits"):
        parse_toml("a = " + "1" * 5000)
