"""List the modules and files that a method's answers depend on, so that runs can be compared.

Modules are found by following `import` statements from the method's own module. That finds the
same ones in every process, while `sys.modules` would depend on what else was loaded before. Files
are noted by Python's audit hook while the method is loaded, fitted and called. It does not see
files that a C library opens by itself, or that another process opens.
"""

import ast
import contextlib
import dis
import functools
import hashlib
import importlib.util
import inspect
import os
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

from dfdbench.errors import MethodError
from dfdbench.system.cache import cache_folder

#: Hashes by label; None for a file that the method wrote itself, which is not compared.
Hashes = dict[str, str | None]
#: Replaces the hash of a file that the method tried to open and did not find.
ABSENT = "absent"

_PACKAGE = Path(os.path.realpath(__file__)).parents[1]
# Only these rooms of dfdbench compute depth. The others read data, print and draw, and a change
# there must not throw away the hours of a run. Releases differ by their version anyway.
_ROOMS = ("dfdbench.methods.", "dfdbench.blur.")
# Methods only take types from this module, which calls them.
_CALLER = "dfdbench.methods.method"
_PLAIN = (bool, int, float, complex, str, bytes, np.generic)
#: Labels of values begin so.
VALUE = "value of "
_NOT_OWN = {"site-packages", "dist-packages", "__pycache__"}


class Sources:
    """The modules and files that one method's answers depend on."""

    def __init__(self) -> None:
        #: Files and folders that do not count, such as those of the data set.
        self.apart: tuple[Path, ...] = ()
        self._module: tuple[str, Path] | None = None
        self._own: Path | None = None
        self._base = Path(os.sep)
        #: Files that were opened for reading, and those that were written.
        self.read: set[str] = set()
        self.written: set[str] = set()
        # Files that were noted: their path if they count, else None.
        self._counted: dict[str, Path | None] = {}
        self._hashes: dict[Path, str] = {}
        self._values: dict[str, str] = {}

    def begin_at(self, module: ModuleType, own: Path | None = None) -> None:
        """Start at the module that defines the method; its folder or package is the method's own.

        If files in another folder make up the method, pass that folder as `own`.
        """
        file = getattr(module, "__file__", None)
        if not isinstance(file, str):
            return
        path = _settled(file)
        self._module = module.__name__, path
        self._base = self._own = path.parent
        levels = module.__name__.count(".") + hasattr(module, "__path__")
        if levels:
            self._own = path.parents[levels - 1]
            self._base = self._own.parent
        elif _NOT_OWN & set(path.parts):
            # It is a single module among the installed packages.
            self._own = path
        if own is not None:
            self._base = self._own = _real(own)
        # Hash it now, while it is still as it was imported.
        self._hash(path)

    def note_values(self, target: Any) -> None:
        """Note what a function or a class is and reads from its module: it may be set anew.

        That covers functions and values. Values that it sets itself do not count, nor do lists and
        mappings, which it may fill, or objects.
        """
        if not isinstance(target, type):
            self._note(f"{VALUE}{getattr(target, '__qualname__', '')}", target)
            return
        ours = str(target.__module__).startswith(_ROOMS)
        for kind in () if ours else target.__mro__:
            # The files of other modules are hashed, and those of libraries do not count.
            own = vars(kind) if kind.__module__ == target.__module__ else {}
            for name, part in own.items():
                part = getattr(part, "__func__", part)
                # A class may change its own values.
                if inspect.isfunction(part):
                    self._note(f"{VALUE}{kind.__qualname__}.{name}", part)

    def _note(self, label: str, value: Any) -> None:
        if label in self._values:
            return
        if digest := _value_sha256(value):
            self._values[label] = digest
            return
        function = inspect.unwrap(value) if inspect.isfunction(value) else None
        # What a decorator wraps may be anything.
        if not inspect.isfunction(function) or str(function.__module__).startswith(_ROOMS):
            return
        self._values[label] = _function_sha256(value)
        read, written = _globals_in(function.__code__)
        for name in read - written:
            other, label = function.__globals__.get(name), f"{VALUE}{name}"
            if inspect.isfunction(other) and other.__globals__ is not function.__globals__:
                self._values.setdefault(label, other.__qualname__)
            self._note(label, other)

    @property
    def module_sha256(self) -> str | None:
        """The SHA-256 of the file that the method is defined in; None if it is in no file."""
        return self._hash(self._module[1]) if self._module else None

    @contextlib.contextmanager
    def watch(self) -> Iterator[None]:
        """Note the files that are opened in the block."""
        _begin_to_hear()
        _listening.append(self)
        try:
            yield
        finally:
            _listening.remove(self)

    def hashes(self) -> Hashes:
        """Return the SHA-256 of everything used so far, by label.

        A label is a relative path within the method's own folder, a full path elsewhere, or the
        dotted name of a module of dfdbench.

        Raises
        ------
        MethodError
            If a module was edited after this process imported it.
        """
        found: Hashes = {**self._modules, **self._values}
        for heard in self.read | self.written:
            if heard not in self._counted:
                path = _source_of(heard)
                self._counted[heard] = path if self._counts(path) else None
            if counted := self._counted[heard]:
                own_work = heard in self.written
                found[self._label(counted)] = None if own_work else self._hash(counted)
        return dict(sorted(found.items()))

    def hashes_again(self, labels: Iterable[str]) -> Hashes:
        """Return the present SHA-256 of the files that an earlier call used."""
        files = (label for label in labels if not label.startswith(VALUE))
        return {**{label: sha256_of(self._path(label)) for label in files}, **self._values}

    @functools.cached_property
    def _modules(self) -> dict[str, str]:
        found: set[Path] = set()
        named: set[str] = set()
        left = [self._module] if self._module else []
        while left:
            name, path = left.pop()
            if path in found:
                continue
            found.add(path)
            self._require_as_imported(name, path)
            # Do not follow the imports of modules elsewhere, such as libraries.
            if name.startswith(_ROOMS) or self._is_own(path):
                new = {*_imported(path, _dotted(path, self._base))} - named
                named |= new
                for other in new:
                    if file := self._file_of_module(other):
                        left.append((other, file))
        return {self._label(path): self._hash(path) for path in found}

    def _file_of_module(self, name: str) -> Path | None:
        if name.startswith(_ROOMS):
            return _file_of(_PACKAGE.parent, name) if name != _CALLER else None
        loaded = getattr(sys.modules.get(name), "__file__", None)
        file = _settled(loaded) if isinstance(loaded, str) else _file_of(self._base, name)
        return file if file and self._counts(file) else None

    def _is_own(self, path: Path) -> bool:
        if self._own is None or not path.is_relative_to(self._own):
            return False
        return not _NOT_OWN & set(path.relative_to(self._own).parts)

    def _counts(self, path: Path) -> bool:
        apart = (_real(place) for place in (*self.apart, cache_folder()))
        if any(path.is_relative_to(place) for place in (*apart, _PACKAGE)) or path.is_dir():
            return False
        if self._own and path.is_relative_to(self._own):
            return self._is_own(path)
        if _NOT_OWN & set(path.parts):
            return False
        return not any(path.is_relative_to(place) for place in _of_the_machine())

    def _label(self, path: Path) -> str:
        if path.is_relative_to(_PACKAGE):
            return _dotted(path, _PACKAGE.parent)
        own = self._own and path.is_relative_to(self._own)
        return (path.relative_to(self._base) if own else path).as_posix()

    def _path(self, label: str) -> Path:
        if label.startswith(_ROOMS):
            return _file_of(_PACKAGE.parent, label) or _PACKAGE / label
        return self._base / label

    def _hash(self, path: Path) -> str:
        if path not in self._hashes:
            self._hashes[path] = sha256_of(path)
        return self._hashes[path]

    def _require_as_imported(self, name: str, path: Path) -> None:
        spec = getattr(sys.modules.get(name), "__spec__", None)
        now = self._hash(path)
        if spec and _as_imported.setdefault(id(spec), (spec, now))[1] != now:
            what = "a module was edited after this process had imported it"
            fix = "start Python again: reload would leave what others imported from it as it was"
            raise MethodError(what, where=str(path), fix=fix)


def changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Say which of the files used earlier have changed.

    Parameters
    ----------
    before, now : mapping of str to str or None
        From `Sources.hashes`. Labels that only one of them has are ignored.

    Examples
    --------
    >>> changes({"helper.py": "0a", "coef.json": "1b"}, {"helper.py": "0c", "coef.json": ABSENT})
    ['helper.py has changed', 'coef.json is gone']
    """
    said = []
    for label, one in before.items():
        other = now.get(label)
        if one is not None and other is not None and one != other:
            how = "is new" if one == ABSENT else "has changed"
            said.append(f"{label} {'is gone' if other == ABSENT else how}")
    return said


# Audit hooks cannot be removed, so there is only one, and it mostly has no listeners.
_listening: list[Sources] = []
# By the id of a module's specification, which is new after a reload. The specification is kept so
# that its id is not reused.
_as_imported: dict[int, tuple[Any, str]] = {}


@functools.cache
def _begin_to_hear() -> None:
    sys.addaudithook(_hear)


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if event != "open" or not _listening:
        return
    # An exception here would look like one of the method's.
    with contextlib.suppress(Exception):
        name, mode, flags = arguments
        if isinstance(name, int):
            return
        path = os.path.abspath(os.fsdecode(name))
        writes = flags & (os.O_WRONLY | os.O_RDWR) if mode is None else set(mode) & set("wax+")
        for sources in _listening:
            (sources.written if writes else sources.read).add(path)


@functools.cache
def _of_the_machine() -> tuple[Path, ...]:
    """Return the folders of Python itself, and those that a machine changes by itself."""
    prefixes = (sys.prefix, sys.base_prefix, sysconfig.get_path("stdlib"), tempfile.gettempdir())
    return tuple(map(_real, (*prefixes, "/dev", "/etc", "/proc", "/sys", "/usr")))


def _real(folder: str | Path) -> Path:
    return Path(os.path.realpath(folder))


def _source_of(heard: str) -> Path:
    # Python opens a module's bytecode instead of the module if that is up to date. If the file is
    # not bytecode, or this Python keeps none, `source_from_cache` raises.
    with contextlib.suppress(ValueError, NotImplementedError):
        if heard.endswith(".pyc"):
            return _settled(importlib.util.source_from_cache(heard))
    return _settled(heard)


def _settled(path: str | Path) -> Path:
    # Keep links to files: they may lead to other files tomorrow.
    folder, name = os.path.split(os.path.abspath(path))
    return _real(folder) / name


def _dotted(path: Path, base: Path) -> str:
    if not path.is_relative_to(base):
        return path.stem
    parts = path.relative_to(base).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _file_of(base: Path, name: str) -> Path | None:
    stem = base.joinpath(*name.split("."))
    for path in (stem.with_name(stem.name + ".py"), stem / "__init__.py"):
        if path.is_file():
            return path
    return None


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file; `ABSENT` if there is none."""
    if not path.is_file():
        return ABSENT
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _imported(path: Path, name: str) -> tuple[str, ...]:
    """Return the names that a module imports, which may be modules or their attributes."""
    try:
        content = path.read_bytes()
    except OSError:
        return ()
    return _imported_in(content, name if path.stem == "__init__" else name.rpartition(".")[0])


# Cached by content, so that a hundred modules are parsed once per process, not once per method and
# data set.
@functools.cache
def _imported_in(content: bytes, package: str) -> tuple[str, ...]:
    names: list[str] = []
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError):
        return ()
    for node in _statements(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                names += _with_parents(alias.name)
        elif isinstance(node, ast.ImportFrom):
            start = ".".join(package.split(".")[: len(package.split(".")) + 1 - node.level])
            above = f"{start}." if node.level and start else ""
            whole = f"{above}{node.module or ''}".rstrip(".")
            names += _with_parents(whole)
            names += (f"{whole}.{alias.name}".lstrip(".") for alias in node.names)
    return tuple(names)


def _statements(tree: ast.AST) -> Iterator[ast.AST]:
    # Not `ast.walk`, which visits every node of every expression.
    left = [tree]
    while left:
        node = left.pop()
        yield node
        for field in ("body", "orelse", "finalbody", "handlers", "cases"):
            left += getattr(node, field, ())


def _globals_in(code: CodeType) -> tuple[set[str], set[str]]:
    """Return the names of the module that a function's code reads, and those that it sets."""
    read, written = set[str](), set[str]()
    for step in dis.get_instructions(code):
        if step.opname == "LOAD_GLOBAL":
            read.add(step.argval)
        elif step.opname == "STORE_GLOBAL":
            written.add(step.argval)
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            more = _globals_in(inner)
            read, written = read | more[0], written | more[1]
    return read, written


def _function_sha256(function: Any) -> str:
    """Return the SHA-256 of a function's text and defaults, and of what it wraps."""
    told = []
    while inspect.isfunction(function):
        try:
            text = inspect.getsource(function.__code__)
        except (OSError, TypeError):
            text = function.__qualname__
        values = (*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values())
        told += [text, *map(_value_sha256, values)]
        function = getattr(function, "__wrapped__", None)
    return hashlib.sha256(repr(told).encode()).hexdigest()


def _value_sha256(value: Any) -> str:
    """Return the SHA-256 of numbers, texts, arrays, tuples of them; else an empty text."""
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        head = f"{value.dtype.str} {value.shape}".encode()
        return hashlib.sha256(head + np.ascontiguousarray(value).tobytes()).hexdigest()
    if isinstance(value, tuple):
        inner = list(map(_value_sha256, value))
        return hashlib.sha256(repr(inner).encode()).hexdigest() if all(inner) else ""
    # A path may be of one process only.
    plain = isinstance(value, _PLAIN) and not (isinstance(value, str) and os.sep in value)
    return hashlib.sha256(repr(value).encode()).hexdigest() if plain else ""


def _with_parents(name: str) -> Iterator[str]:
    parts = name.split(".")
    yield from (".".join(parts[:number]) for number in range(1, len(parts) + 1) if parts[0])
