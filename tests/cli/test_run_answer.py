from __future__ import annotations

import pytest

from dfdbench.cli.run_answer import tell_overall
from dfdbench.results.record import Result
from dfdbench.results.summary import summarise
from tests.made_results import limited, make_demo_result

WHOLE = make_demo_result(lambda _: 0.1)


@pytest.mark.parametrize(
    ("result", "told"),
    [
        (
            WHOLE,
            "overall      NRMSE 0.1000  NMAE 0.0500  SSIM 0.9000  "
            "(protocol thesis, split test, 54 pairs)",
        ),
        (
            limited(WHOLE, 36),
            "overall      no score: 36 of 54 pairs were evaluated  (protocol thesis, split test)",
        ),
    ],
)
def test_the_scores_over_all_pairs_are_a_line(
    result: Result, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tell_overall(summarise(result, "thesis"))
    assert capsys.readouterr().err == told + "\n"


def test_pairs_that_the_store_lacks_are_said(capsys: pytest.CaptureFixture[str]) -> None:
    short = limited(WHOLE, 53)
    last = short.pairs[-1].model_copy(update={"status": "missing"})
    tell_overall(summarise(short.model_copy(update={"pairs": [*short.pairs[:-1], last]}), "thesis"))
    assert "53 of 54 pairs were evaluated; 1 pair not in the store" in capsys.readouterr().err
