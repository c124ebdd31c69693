"""Do one thing for many items at once: in threads, in processes, on a Dask cluster."""

import logging
import os
import re
import threading
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from concurrent import futures
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from dfdbench.errors import InputError

Item = TypeVar("Item")
Outcome = TypeVar("Outcome")
#: An item's number and its outcome, as soon as it is available.
Done = Generator[tuple[int, Outcome], None, None]
#: Called with (items done, total items) after each item.
OnDone = Callable[[int, int], None]
#: Shows the progress of a step: entered with what is done, it gives a callable (done, total).
Shown = Callable[[str], AbstractContextManager[Callable[..., None] | None]]

_SECONDS_TO_ANSWER = 30
#: The form of a scheduler's address: HOST:PORT, with or without a protocol before it.
_ADDRESS = re.compile(r"((tcp|tls|ws|wss|ucx|ucxx)://)?(\[[^\]]+\]|[^\s/:]+):\d+|inproc://\S+")


def one_by_one(items: Collection[Item], on_done: OnDone | None) -> Iterator[Item]:
    """Yield each item; call `on_done` with (items done, total items) after each one.

    Examples
    --------
    >>> for letter in one_by_one("ab", lambda done, total: print(done, "of", total)):
    ...     print(letter)
    a
    1 of 2
    b
    2 of 2
    """
    for number, item in enumerate(items, 1):
        yield item
        if on_done:
            on_done(number, len(items))


class Pool(ABC):
    """Base of the places where work is done."""

    def map(
        self,
        function: Callable[[Item], Outcome],
        items: Sequence[Item],
        on_outcome: Callable[[Item, Outcome], None] | None = None,
        on_done: OnDone | None = None,
    ) -> list[Outcome]:
        """Return the function's result for each item, in the items' order.

        Parameters
        ----------
        function : callable
            Called once per item. For processes and clusters it must be picklable.
        items : sequence
            The arguments of the calls.
        on_outcome : callable, optional
            Called with (item, outcome) after each item as it is done, in the calling thread.
        on_done : callable, optional
            Called after that with (items done, total items).
        """
        outcomes: dict[int, Outcome] = {}
        # Closed as soon as something fails, so that work nobody waits for is cancelled.
        with closing(self._as_done(function, items)) as done:
            for number, outcome in done:
                outcomes[number] = outcome
                if on_outcome:
                    on_outcome(items[number], outcome)
                if on_done:
                    on_done(len(outcomes), len(items))
        return [outcomes[number] for number in range(len(items))]

    @abstractmethod
    def _as_done(self, function: Callable[[Item], Outcome], items: Sequence[Item]) -> Done[Outcome]:
        """Yield each item's number and the function's result, as each is done."""


@dataclass(frozen=True)
class Threads(Pool):
    """Work in threads of this process.

    Parameters
    ----------
    workers : int
        How many items to work on at once.

    Examples
    --------
    >>> Threads(2).map(abs, [-1, -2, -3])
    [1, 2, 3]
    """

    workers: int = 1

    def _as_done(self, function: Callable[[Item], Outcome], items: Sequence[Item]) -> Done[Outcome]:
        return _computed(futures.ThreadPoolExecutor(self.workers), function, items)


@dataclass(frozen=True)
class Processes(Pool):
    """Work in processes on this machine, for tasks that do not share a process well.

    Parameters
    ----------
    workers : int
        How many items to work on at once.
    """

    workers: int = 1

    def _as_done(self, function: Callable[[Item], Outcome], items: Sequence[Item]) -> Done[Outcome]:
        from multiprocessing import get_context  # most commands finish without it

        # Forking a process that has threads (numba's, zarr's) can hang, so start a fresh one.
        context = get_context("spawn")
        pool = futures.ProcessPoolExecutor(self.workers, context, initializer=_begin_worker)
        try:
            yield from _computed(pool, function, items)
        except futures.BrokenExecutor as error:
            what = "a worker ended without a word: out of memory, or its code ended the process"
            fix = "give fewer workers; what is done is kept, and the same command goes on"
            # A worker imports the script that started it, which must not start workers again.
            fix += '; a script has to start them under `if __name__ == "__main__":`'
            raise InputError(what, where="--workers", fix=fix) from error


@dataclass(frozen=True)
class Cluster(Pool):
    """Work on a `dask.distributed` cluster whose workers have dfdbench installed.

    Parameters
    ----------
    address : str
        The scheduler's address, such as ``tcp://node1:8786``.

    Raises
    ------
    InputError
        From `map`, if dask.distributed is not installed, no scheduler answers, it goes away, or
        the same item ends one worker after another.
    """

    address: str

    def _as_done(self, function: Callable[[Item], Outcome], items: Sequence[Item]) -> Done[Outcome]:
        with _client(self.address) as (client, as_completed):
            from distributed import KilledWorker

            if not client.scheduler_info()["workers"]:
                what = f"no worker is connected to {self.address} yet; dask worker starts one"
                warnings.warn(what, stacklevel=2)
            sent = client.map(function, items, pure=False, batch_size=1)
            place = {future.key: number for number, future in enumerate(sent)}
            try:
                for future, outcome in as_completed(sent, loop=client.loop, with_results=True):
                    # Cancelled work also arrives as an outcome.
                    if future.cancelled():
                        raise _gone(self.address)
                    yield place[future.key], outcome
            except KilledWorker as error:
                what = "workers ended without a word: out of memory, or the code ended the process"
                fix = "their logs say more; what is done is kept, and the same command goes on"
                raise InputError(what, where=f"--scheduler {self.address}", fix=fix) from error
            finally:
                if client.status == "running":
                    client.cancel(sent)


def _begin_worker() -> None:
    from multiprocessing import parent_process, set_start_method
    from multiprocessing.connection import wait

    # A process that a method starts in a worker must begin as it would outside of one.
    set_start_method(None, force=True)

    keep_quiet_of_abandoned_tasks()
    # If the parent is killed, nobody takes a worker's results: it would go on to write what the
    # next call writes, too, and then wait forever.
    parent = parent_process()
    assert parent is not None

    def end(sentinel: int = parent.sentinel) -> None:
        wait([sentinel])
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def _computed(
    pool: futures.Executor, function: Callable[[Item], Outcome], items: Sequence[Item]
) -> Done[Outcome]:
    try:
        numbers = {pool.submit(function, item): number for number, item in enumerate(items)}
        for done in futures.as_completed(numbers):
            yield numbers[done], done.result()
    finally:
        # Even after Ctrl-C, finish what has begun, so that nothing is left half-written.
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _client(address: str) -> Iterator[tuple[Any, Any]]:
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        fix = "pip install 'dfdbench[cluster]', here and on the cluster's workers"
        what = f"dask.distributed is not installed: {error}"
        raise InputError(what, where="--scheduler", fix=fix) from error
    if not _ADDRESS.fullmatch(address):
        # If asked anyway, the client's threads would keep the command from ending.
        what = f"not a scheduler's address, such as tcp://node1:8786: {address}"
        raise InputError(what, where="--scheduler")
    try:
        client = Client(address, timeout=_SECONDS_TO_ANSWER, set_as_default=False)
    except (OSError, ValueError) as error:
        what = f"no scheduler answers at {address}: {error}"
        raise InputError(what, where="--scheduler", fix="start one with: dask scheduler") from error
    # Report a scheduler that goes away, or a stop, once and in our words.
    logs = [logging.getLogger(name) for name in ("distributed.client", "tornado.application")]
    levels = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL)
    try:
        with client:
            yield client, as_completed
    finally:
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)


def _gone(address: str) -> InputError:
    what = f"the scheduler at {address} went away, or its work was cancelled"
    fix = "start it again: the same command goes on with what is left to do"
    return InputError(what, where="--scheduler", fix=fix)


# What asyncio prints, with a traceback, whenever the garbage collector runs.
_SAID = (
    "Task exception was never retrieved",
    "Future exception was never retrieved",
    "Task was destroyed but it is pending!",
)


def keep_quiet_of_abandoned_tasks() -> None:
    """Stop asyncio from printing tracebacks of tasks that nobody waits for any more.

    zarr reads the members of a group all at once. The first unreadable one raises an error that
    names it; for the others asyncio prints tracebacks, now or later, as if dfdbench had broken.
    """
    logging.getLogger("asyncio").addFilter(_is_news)


def _is_news(record: logging.LogRecord) -> bool:
    return not record.getMessage().startswith(_SAID)
