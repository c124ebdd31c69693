from __future__ import annotations

import pytest

from dfdbench.training.ending import EndedBy


@pytest.mark.parametrize(
    ("text", "ended", "early"),
    [
        ("its number of steps", EndedBy.STEPS, False),
        ("learning rate 1e-10", EndedBy.LEARNING_RATE, False),
        ("its time limit", EndedBy.TIME_LIMIT, True),
        ("its time limit, within the warm-up, at step 1 of 5", EndedBy.TIME_LIMIT_IN_WARM_UP, True),
    ],
)
def test_what_a_card_says_ended_it(text: str, ended: EndedBy, early: bool) -> None:
    assert EndedBy.of(text) is ended
    assert ended.early is early


def test_words_of_another_program() -> None:
    assert EndedBy.of("hand") is None
