"""Change one operator or constant of a room at a time, and see if its tests notice."""

import ast
import os
import random
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import typer

_PAIRS = "Lt LtE,Gt GtE,Eq NotEq,In NotIn,Is IsNot,And Or,Add Sub,Mult Div,BitAnd BitOr"
_COUNTERPART = {a: b for pair in _PAIRS.split(",") for a, b in (pair.split(), pair.split()[::-1])}
# Tests of behaviour cannot notice types, and a wrong decorator fails on import.
_LEFT_ALONE = {"annotation", "returns", "decorator_list"}
_PYTEST = shlex.split("-m pytest -xqp no:cacheprovider -n 0 --benchmark-skip -m 'not slow'")


def replacements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what to put in a node's place."""
    match node:
        case ast.cmpop() | ast.operator() | ast.boolop():
            if other := _COUNTERPART.get(type(node).__name__):
                yield getattr(ast, other)()
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            yield operand
        case ast.Constant(bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(int(value) | float(value)):
            yield from (ast.Constant(value + 1), ast.Constant(value - 1))
        case ast.Return(None | ast.Constant(None)) | ast.Continue() | ast.Break():
            yield ast.Pass()
        case ast.Return():
            yield ast.Return(ast.Constant(None))


def mutants(path: Path) -> Iterator[tuple[Path, str, str]]:
    """Yield the path, a description and the changed source of each mutant of a module."""
    tree = ast.parse(path.read_text("utf-8"))

    def within(parent: ast.AST) -> Iterator[tuple[Path, str, str]]:
        for field, value in ast.iter_fields(parent):
            if field in _LEFT_ALONE or getattr(parent, "arg", None) == "strict":
                continue
            nodes = value if isinstance(value, list) else [value]
            for place, node in enumerate(nodes):
                if not isinstance(node, ast.AST):
                    continue
                # An operator alone has no line and says little.
                shown = node if hasattr(node, "lineno") else parent
                before = ast.unparse(shown)
                for new in replacements(node):
                    nodes[place] = new
                    setattr(parent, field, value if nodes is value else new)
                    after = ast.unparse(new if shown is node else parent)
                    where = f"{path}:{getattr(shown, 'lineno', 0)}"
                    yield path, f"{where}: {before}  ->  {after}", ast.unparse(tree)
                    nodes[place] = node
                    setattr(parent, field, value)
                yield from within(node)

    return within(tree)


def passes(tests: list[Path], timeout: float, **variables: str) -> bool:
    """Return whether tests pass; if they hang, they do not."""
    process = subprocess.Popen(
        [sys.executable, *_PYTEST, *tests],
        env={**os.environ, "PYTHONPATH": os.getcwd(), "OMP_NUM_THREADS": "1", **variables},
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return process.wait(timeout) == 0
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        return False


def main(room: str, count: int = 25, seed: int = 31) -> None:
    """Draw mutants of a room, and run its tests on each in a copy of the working tree."""
    root = Path.cwd()
    os.environ.setdefault("DFDBENCH_SHARED_DATA", str(root.parent / "shared" / "data"))
    listed = subprocess.check_output(["git", "ls-files", "-co", "--exclude-standard"], text=True)
    with tempfile.TemporaryDirectory() as copy:
        for name in filter(os.path.isfile, listed.splitlines()):
            Path(copy, name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(name, Path(copy, name))
        Path(copy, ".git").symlink_to(root / ".git")  # some tests ask for the commit
        os.chdir(copy)
        tests, killed, begun = Path("tests", room), 0, time.monotonic()
        if not passes([tests], 3600):
            sys.exit(f"{tests} fails as it is: mend it first")
        timeout = 30 + 4 * (time.monotonic() - begun)
        every = [m for path in sorted(Path("dfdbench", room).rglob("*.py")) for m in mutants(path)]
        for path, change, source in random.Random(seed).sample(every, min(count, len(every))):
            original = path.read_bytes()
            path.write_text(source, "utf-8")
            own = Path("tests", *path.parts[1:-1], f"test_{path.name}")
            first = [each for each in (path, own) if each.is_file()]
            with tempfile.TemporaryDirectory() as machine_code:
                # Numba would run callers that it compiled before, with the old code inside.
                kept = {"NUMBA_CACHE_DIR": machine_code, "PYTHONDONTWRITEBYTECODE": "1"}
                survives = passes(first, timeout, **kept) and passes([tests], timeout, **kept)
            path.write_bytes(original)
            killed += not survives
            print("survived" if survives else "killed  ", change, flush=True)
    print(f"{room}: {killed} of {min(count, len(every))} killed; there are {len(every)} mutants")


if __name__ == "__main__":
    typer.run(main)
