import threading
import time

import pytest

from dfdbench.parallel import for_each


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_answers_come_in_the_items_order(workers: int) -> None:
    seen: list[int] = []

    def slow_first(item: int) -> int:
        time.sleep(0.02 if item == 0 else 0)
        return item * item

    answers = for_each(slow_first, range(12), workers, on_done=lambda: seen.append(1))
    assert answers == [item * item for item in range(12)]
    assert len(seen) == 12


def test_workers_work_at_once_and_errors_come_through() -> None:
    barrier = threading.Barrier(2, timeout=10)
    for_each(lambda _: barrier.wait(), range(2), workers=2)

    def fail(_: int) -> None:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        for_each(fail, [1, 2], workers=2)
