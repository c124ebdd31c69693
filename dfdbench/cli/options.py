"""Options that several verbs have in common."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from dfdbench.errors import InputError, Problem
from dfdbench.parallel import Cluster, Pool, Processes, Threads

Cache = Annotated[
    Path | None,
    typer.Option(
        envvar="DFDBENCH_CACHE", help="Folder of downloads and stores; default: the platform's."
    ),
]
Workers = Annotated[
    int | None, typer.Option(min=1, help="How many at once; default: one a processor core.")
]
Scheduler = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="A dask.distributed scheduler, as tcp://node1:8786."),
]


def pool_of(workers: int | None, scheduler: str | None = None) -> Pool:
    """Return where our own work is done: in threads unless on a cluster.

    Raises
    ------
    InputError
        Where both are named: a cluster has its own number of workers.
    """
    return _cluster(workers, scheduler) or Threads(workers or os.cpu_count() or 1)


def pool_of_processes(workers: int | None, scheduler: str | None) -> Pool | None:
    """Return where others' methods are called; None for this process, one pair at a time.

    Raises
    ------
    InputError
        As `pool_of` does.
    """
    here = Processes(workers) if workers and workers > 1 else None
    return _cluster(workers, scheduler) or here


def _cluster(workers: int | None, scheduler: str | None) -> Cluster | None:
    if scheduler and workers:
        raise InputError(
            Problem("a cluster has its own number of workers", "--workers", fix="leave it out")
        )
    return Cluster(scheduler) if scheduler else None
