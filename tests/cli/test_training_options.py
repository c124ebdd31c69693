import pytest

from dfdbench.cli.training_options import seconds_of, stepping
from dfdbench.errors import InputError


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("90s", 90), ("30m", 1800), ("1h30m", 5400), ("2h1m5.5s", 7265.5), ("0.5h", 1800)],
)
def test_a_duration_is_told_in_hours_minutes_and_seconds(text: str, seconds: float) -> None:
    assert seconds_of(text) == seconds


def test_no_duration_is_no_limit() -> None:
    assert seconds_of(None) is None


@pytest.mark.parametrize("text", ["", "30", "0s", "0h0m", "-5m", "5m1h", "1.5", "1e3s", "soon"])
def test_what_is_no_duration_is_told(text: str) -> None:
    with pytest.raises(InputError, match="not a duration") as caught:
        seconds_of(text)
    assert caught.value.problems[0].where == "--max-time"


def test_the_bar_is_told_steps_without_the_loss() -> None:
    seen: list[tuple[int, int | None]] = []
    step = stepping(lambda done, total: seen.append((done, total)))
    step(3, 10, 0.25)
    step(4, None, 0.125)
    assert seen == [(3, 10), (4, None)]
