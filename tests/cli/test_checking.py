import pytest

from tests.cli.command import Command


def test_check_method_passes_and_fails(dfdbench: Command) -> None:
    told = ("--param", "window=3", "--param", "recipe=published")
    good = dfdbench("check-method", "local", *told)
    assert (good.status, "fit for a run" in good.out) == (0, True)
    bad = dfdbench("check-method", "mymodule:nan")
    assert (bad.status, "NaN" in bad.out) == (1, True)
    # It prints, on each of the nine pairs.
    assert "fit for a run, 9 warnings" in dfdbench("check-method", "mymodule:predict").out


@pytest.mark.slow
def test_check_method_calibrates_a_method_that_is_not_told_the_blur(dfdbench: Command) -> None:
    good = dfdbench("check-method", "local", "--param", "window=3")
    assert (good.status, "fit for a run" in good.out) == (0, True)
    assert "fit, on two made pairs" in good.out
