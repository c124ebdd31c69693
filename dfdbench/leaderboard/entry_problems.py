"""Whether the method that a submitted result names is found by that name, with its source."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from dfdbench.errors import Problem
from dfdbench.evaluation.result import without_folder
from dfdbench.methods.registry import built_in_methods, registered_methods
from dfdbench.results.record import MethodRecord


def entry_problems(method: MethodRecord, path: Path) -> list[Problem]:
    """Return what is wrong where a result's method is not found by its name.

    The name is what runs, the entry what a reader takes for its origin: they must be one. A
    name that is not registered here is another package's, of which nothing is known. Depth maps
    made elsewhere have no entry; their title keeps them apart from a method of the same name.
    """
    if method.scored:
        return []
    entry = method.name if ":" in method.name else registered_methods().get(method.name)
    if entry is None or without_folder(entry) == method.entry:
        return list(_without_hash(method, path))
    return [
        Problem(
            "the method's name leads to another entry",
            where=f"{path}: method.entry",
            expected=without_folder(entry),
            got=method.entry,
            fix="submit the run again with this version",
        )
    ]


def _without_hash(method: MethodRecord, path: Path) -> Iterator[Problem]:
    if method.entry in built_in_methods().values() and method.source_sha256 is None:
        yield Problem(
            "the hash of the method's source is lacking",
            where=f"{path}: method.source_sha256",
            expected="64 hexadecimal digits: a built-in method has a source",
            got="null",
            fix="submit the run again with this version",
        )
