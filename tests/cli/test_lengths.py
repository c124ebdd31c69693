import pytest

from dfdbench.cli.lengths import parse_length
from dfdbench.errors import InputError


@pytest.mark.parametrize(
    ("text", "metres"),
    [("9.6mm", 9.6e-3), ("0.5m", 0.5), ("4.8um", 4.8e-6), ("4.8µm", 4.8e-6), (" 3 cm ", 0.03)],
)
def test_a_length_is_read_in_metres(text: str, metres: float) -> None:
    assert parse_length(text, "--pixel") == pytest.approx(metres, rel=1e-15)


@pytest.mark.parametrize("text", ["9.6", "mm", "-1m", "0m", "1 inch", "nanm", "1e999m", ""])
def test_what_is_no_length_is_refused_by_name(text: str) -> None:
    with pytest.raises(InputError, match="--pixel"):
        parse_length(text, "--pixel")


def test_a_bare_number_takes_the_unit_that_is_offered() -> None:
    assert parse_length("1.5", "--range", unit="m") == 1.5
    assert parse_length("150cm", "--range", unit="m") == 1.5
