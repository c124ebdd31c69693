"""Do one thing for many items at once, through Dask."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from dask.base import compute
from dask.callbacks import Callback
from dask.delayed import delayed

Item = TypeVar("Item")
Outcome = TypeVar("Outcome")


def for_each(
    function: Callable[[Item], Outcome],
    items: Sequence[Item],
    workers: int,
    on_done: Callable[[], None] | None = None,
) -> list[Outcome]:
    """Return what a function gives for each item, in the items' order.

    Parameters
    ----------
    function : callable
        Called once an item, from several threads where there are several workers.
    items : sequence
        What it is called with.
    workers : int
        How many items are worked on at once.
    on_done : callable, optional
        Called after each item, from the calling thread.

    Examples
    --------
    >>> for_each(abs, [-1, -2, -3], workers=2)
    [1, 2, 3]
    """

    def posttask(*_: Any) -> None:
        if on_done:
            on_done()

    tasks = [delayed(function, pure=False)(item) for item in items]
    pool = ThreadPoolExecutor(workers)
    try:
        with Callback(posttask=posttask):
            return list(compute(*tasks, scheduler="threads", pool=pool))
    finally:
        # After Ctrl-C, too: what has begun is finished, so that nothing is left half-written.
        pool.shutdown(wait=True, cancel_futures=True)
