"""The method that a result names: what running it would import, found without importing it."""

from __future__ import annotations

import ast
import hashlib
import json
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.resources import files
from pathlib import Path
from typing import Any

from dfdbench.errors import Problem, ResultError, unknown_name
from dfdbench.methods.registry import built_in_methods, registered_methods
from dfdbench.results.record import MethodRecord


@dataclass(frozen=True)
class ClaimedMethod:
    """A result's method, before anything of it is imported.

    Parameters
    ----------
    record : MethodRecord
        What the result says.
    file : Path or None
        The file that would be imported; None for a built-in method.
    file_sha256 : str or None
        Of that file.
    """

    record: MethodRecord
    file: Path | None = None
    file_sha256: str | None = None

    def __str__(self) -> str:
        # As ASCII: what the result says must not steer the terminal that shows it.
        same = self.file_sha256 == self.record.source_sha256
        lines = (
            ("entry", json.dumps(self.record.entry)),
            ("parameters", json.dumps(self.record.parameters)),
            ("file", json.dumps(str(self.file))),
            ("its SHA-256", str(self.file_sha256)),
            ("recorded", "the same" if same else f"{self.record.source_sha256}: ANOTHER FILE"),
        )
        return "\n".join(f"{label:<12} {text}" for label, text in lines)

    def require_consent(self, trusted: Collection[str], path: Path) -> None:
        """Refuse a method that is not built in unless its very entry is trusted.

        Raises
        ------
        ResultError
            Where it is neither; the error says what would be imported.
        """
        if self.file is None or self.record.entry in trusted:
            return
        raise ResultError(
            what="the result's method is not ours: its code is run only if you agree",
            where=f"{path}: method.entry",
            expected="a built-in method, or your consent",
            got=str(self).replace("\n", "\n            "),
            fix=f"read the file; then --trust {self.record.entry!a}, in a container: "
            "CONTRIBUTING.md",
        )


def claimed_method(record: MethodRecord, path: Path) -> ClaimedMethod:
    """Return what running a result's method would import. Nothing is imported.

    Parameters
    ----------
    record : MethodRecord
        What the result says of its method.
    path : Path
        The result's file, for messages.

    Raises
    ------
    ResultError
        Where the entry leads to no source file that defines it: nothing of the standard library,
        no compiled module, nothing that a module only imports is a method.
    UnknownNameError
        Where the name is registered by no package that is installed here.
    """
    where = f"{path}: method.entry"
    known = registered_methods()
    if ":" not in record.name and record.name not in known:
        raise unknown_name("method", record.name, known, "Install the package that offers it.")
    if _built_in_name(record):
        return ClaimedMethod(record)
    place, _, attribute = record.entry.rpartition(":")
    if not attribute.isidentifier() or attribute.startswith("_"):
        raise _refused("the entry names nothing that can be a method", where, record.entry)
    file = _own_file(place, where) if place.endswith(".py") else _module_file(place, where)
    content = file.read_bytes()
    if not _defines(content, attribute, place):
        raise ResultError(
            what="the file does not define the method itself",
            where=where,
            expected=f"a class, a function or a value {attribute} in {file}",
            got="nothing of that name, or another package's",
            fix="submit the run under the entry that defines it",
        )
    return ClaimedMethod(record, file, hashlib.sha256(content).hexdigest())


def parameters_to_run(record: MethodRecord, weights: Path | None, path: Path) -> dict[str, Any]:
    """Return a result's parameters with the reviewer's file in place of the one they name.

    Parameters
    ----------
    record : MethodRecord
        What the result says of its method.
    weights : Path or None
        The reviewer's copy of the weights.
    path : Path
        The result's file, for messages.

    Raises
    ------
    ResultError
        Where a result's own weights are needed and not given, or are not those of the run.
    """
    named = record.parameters.get("weights")
    suffix = f"-{_built_in_name(record)}.safetensors"
    there = [file.name for file in files("dfdbench.methods.networks.pretrained").iterdir()]
    shipped = sorted(name.removesuffix(suffix) for name in there if name.endswith(suffix))
    if named is None or named in shipped:
        return dict(record.parameters)
    if weights is None:
        if not _built_in_name(record):
            # The code is trusted, and what it makes of its parameters with it.
            return dict(record.parameters)
        raise ResultError(
            what="the result's weights are a file, which it must not choose",
            where=f"{path}: method.parameters.weights",
            expected=f"shipped weights, one of: {', '.join(shipped) or 'none'}",
            got=ascii(named),
            fix="name your copy of it: --weights FILE",
        )
    found = hashlib.sha256(weights.read_bytes()).hexdigest() if weights.is_file() else "no file"
    if found != record.weights_sha256:
        raise ResultError(
            what="other weights than the result was made with",
            where=str(weights),
            expected=str(record.weights_sha256),
            got=found,
        )
    return {**record.parameters, "weights": str(weights)}


def other_claims(
    record: MethodRecord, found: Mapping[str, object], path: Path
) -> Iterator[Problem]:
    """Tell where a record says other of what its method was told and has seen than was found.

    Parameters
    ----------
    record : MethodRecord
        What a result claims.
    found : mapping of str to object
        Fields of the record, as running the method anew gives them.
    path : Path
        The result's file.
    """
    for field, value in found.items():
        claimed = getattr(record, field)
        claimed = sorted(claimed) if isinstance(claimed, list) else claimed
        if claimed != value:
            yield Problem(
                "the method is told, or was trained, other than the result says",
                where=f"{path}: method.{field}",
                expected=f"{value} (run here)",
                got=str(claimed),
                fix="submit the run again with this version",
            )


def _built_in_name(record: MethodRecord) -> str:
    names = (name for name, entry in built_in_methods().items() if entry == record.entry)
    return next(names, "")


def _own_file(place: str, where: str) -> Path:
    file = Path(place)
    if file.is_absolute() or not file.is_file():
        raise _refused(f"no such file below {Path.cwd()}", where, place)
    return file.resolve()


def _module_file(name: str, where: str) -> Path:
    parts = name.split(".")
    if not all(part.isidentifier() for part in parts):
        raise _refused("the entry names no module", where, name)
    if parts[0] in {*sys.stdlib_module_names, *sys.builtin_module_names, "__main__", "dfdbench"}:
        raise _refused("this module holds no method, and is not run as one", where, name)
    specification = _specification(parts)
    if specification is None:
        raise _refused(f"no module of that name, in {Path.cwd()} or installed", where, name)
    file = Path(specification.origin or "")
    if not isinstance(specification.loader, SourceFileLoader) or file.suffix != ".py":
        raise _refused("the module has no source file that could be read", where, name)
    loaded = getattr(sys.modules.get(name), "__file__", None)
    if loaded and Path(loaded).resolve() != file.resolve():
        raise _refused(f"another module of that name is loaded, {loaded}", where, name)
    return file.resolve()


def _specification(parts: Sequence[str]) -> ModuleSpec | None:
    # importlib.util.find_spec would import the packages that a module lies in.
    before = list(sys.path)
    sys.path.insert(0, str(Path.cwd()))
    try:
        search: Sequence[str] | None = None
        specification = None
        for count in range(1, len(parts) + 1):
            if count > 1 and search is None:
                return None
            specification = _find(".".join(parts[:count]), search)
            if specification is None:
                return None
            search = specification.submodule_search_locations
        return specification
    finally:
        sys.path[:] = before


def _find(name: str, search: Sequence[str] | None) -> ModuleSpec | None:
    for finder in sys.meta_path:
        try:
            found = finder.find_spec(name, search)
        except (AttributeError, ImportError, KeyError, ValueError):
            continue
        if found is not None:
            return found
    return None


def _defines(content: bytes, attribute: str, place: str) -> bool:
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError):
        return False
    package = "" if place.endswith(".py") else place.split(".")[0]
    return attribute in _names_of(tree.body, package)


def _names_of(body: Sequence[ast.stmt], package: str) -> Iterator[str]:
    for statement in body:
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            yield statement.name
        elif isinstance(statement, ast.Assign | ast.AnnAssign):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            yield from (target.id for target in targets if isinstance(target, ast.Name))
        elif isinstance(statement, ast.ImportFrom):
            # Of the same package only: what is imported from elsewhere is somebody else's.
            if statement.level or (statement.module or "").split(".")[0] == package:
                yield from (name.asname or name.name for name in statement.names)
        elif isinstance(statement, ast.If | ast.Try):
            yield from _names_of([*statement.body, *statement.orelse], package)


def _refused(what: str, where: str, got: str) -> ResultError:
    return ResultError(
        what=what,
        where=where,
        expected="module:name or file.py:name of source that is here",
        got=ascii(got),
    )
