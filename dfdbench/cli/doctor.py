"""The verb that says what is installed here and what the machine can do: doctor."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated

import typer

from dfdbench.cli.options import Cache
from dfdbench.cli.screen import print_table
from dfdbench.results.environment import describe_environment
from dfdbench.results.record import Environment
from dfdbench.system.cache import cache_entries, cache_folder
from dfdbench.system.extras import EXTRAS
from dfdbench.tables.render import render
from dfdbench.tables.table import Format, Table

#: Of the environment, what changes how libraries and dfdbench itself work.
_VARIABLES = (
    "DFDBENCH_CACHE",
    "DFDBENCH_SHARED_DATA",
    "OMP_NUM_THREADS",
    "NUMBA_CACHE_DIR",
    "NUMBA_NUM_THREADS",
    "NUMBA_DISABLE_JIT",
    "CUDA_VISIBLE_DEVICES",
)


def doctor(
    format: Annotated[Format, typer.Option(help="How the table is printed.")] = Format.table,
    cache: Cache = None,
) -> None:
    """Say what is installed here and what the machine can do: for bug reports."""
    nets = list(_nets())
    # PyTorch is imported by now, so that its threads and its GPU are seen.
    found = describe_environment()
    rows = [*_system(found), *nets, *_extras(), *_place(cache_folder(cache))]
    rows += [_compiled(), *_variables()]
    table = Table("dfdbench, here", ("what", "found"), tuple(rows), "ll")
    print_table(table) if format is Format.table else print(render([table], format), end="")


def _system(found: Environment) -> Iterator[tuple[str, str]]:
    commit = f", commit {found.git}" if found.git else ""
    yield "dfdbench", f"{found.versions['dfdbench']}{commit}"
    yield "python", f"{found.python}, {found.platform}"
    yield "processor", f"{found.cpu}, {found.cpu_count} cores"
    yield "threads", ", ".join(f"{name} {count}" for name, count in found.threads.items())
    libraries = [f"{name} {v}" for name, v in found.versions.items() if name != "dfdbench"]
    yield "libraries", ", ".join(libraries)


def _nets() -> Iterator[tuple[str, str]]:
    try:
        import torch

        from dfdbench.training.configuration import precision_for
    except ModuleNotFoundError:
        return
    devices = [torch.device("cpu")] + [torch.device("cuda")] * torch.cuda.is_available()
    for device in devices:
        precision, reason = precision_for(device)
        yield f"trains on {device.type} in", f"{precision}: {reason}"
    yield "gpu", torch.cuda.get_device_name() if torch.cuda.is_available() else "none"


def _extras() -> Iterator[tuple[str, str]]:
    for extra, modules in EXTRAS.items():
        try:
            there = ", ".join(f"{module} {version(module)}" for module in modules)
        except PackageNotFoundError:
            there = f"absent: pip install 'dfdbench[{extra}]'"
        yield f"extra {extra}", there


def _place(folder: Path) -> Iterator[tuple[str, str]]:
    entries = cache_entries(folder)
    size = sum(entry.size for entry in entries)
    above = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    free = shutil.disk_usage(above).free
    writable = "" if os.access(above, os.W_OK) else ", cannot be written"
    yield "cache", f"{folder}: {_in_bytes(size)}, {_in_bytes(free)} free{writable}"
    stores = [entry.name.removesuffix(".zarr") for entry in entries if entry.kind == "stores"]
    yield "built", ", ".join(stores) or "nothing"


def _compiled() -> tuple[str, str]:
    from dfdbench.metrics.similarity import mean_similarity

    # Of one module; if not told otherwise, numba has a folder for each.
    place = mean_similarity.stats.cache_path
    return "compiled code", place or "not cached, so each command compiles: set NUMBA_CACHE_DIR"


def _in_bytes(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"


def _variables() -> Iterator[tuple[str, str]]:
    for name in _VARIABLES:
        if name in os.environ:
            yield name, os.environ[name]
