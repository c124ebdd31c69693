"""Keep quiet about tasks that a library gave up: the first that failed told what is wrong."""

from __future__ import annotations

import logging

# What asyncio says, with a traceback, whenever the garbage collector comes by.
_SAID = (
    "Task exception was never retrieved",
    "Future exception was never retrieved",
    "Task was destroyed but it is pending!",
)


def keep_quiet_of_abandoned_tasks() -> None:
    """Let asyncio say nothing of the tasks that nobody waits for any more.

    zarr reads the members of a group all at once. The first that cannot be read is raised, and
    told by name; of the others asyncio prints tracebacks, now or later, as if dfdbench had broken.
    """
    logging.getLogger("asyncio").addFilter(_is_news)


def _is_news(record: logging.LogRecord) -> bool:
    return not record.getMessage().startswith(_SAID)
