"""Count lines of code, without docstrings, comments and blank lines: `python -m tests.size`."""

import ast
import io
import tokenize
from pathlib import Path

ROOT = Path(__file__).parents[1]
_NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
_WITH_DOCSTRING = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def code_lines(source: str) -> int:
    """Return the number of lines that hold code, docstrings not counted."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    lines = {
        line
        for token in tokens
        if token.type not in _NO_CODE
        for line in range(token.start[0], token.end[0] + 1)
    }
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, _WITH_DOCSTRING) and ast.get_docstring(node, clean=False) is not None:
            lines -= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return len(lines)


def main() -> None:
    """Print modules, lines and lines a module, by room."""
    for top in ("dfdbench", "tests"):
        rooms: dict[str, list[tuple[int, int]]] = {}
        for path in sorted((ROOT / top).rglob("*.py")):
            inside = path.relative_to(ROOT / top).parts
            source = path.read_text("utf-8")
            imports = sum(
                (node.end_lineno or 0) - node.lineno + 1
                for node in ast.walk(ast.parse(source))
                if isinstance(node, ast.Import | ast.ImportFrom)
            )
            room = inside[0] if len(inside) > 1 else "."
            rooms.setdefault(room, []).append((code_lines(source), imports))
        everything = [file for files in rooms.values() for file in files]
        for room, files in [*rooms.items(), ("all", everything)]:
            lines, imports = (sum(each) for each in zip(*files, strict=True))
            modules = len([file for file in files if file[0]])
            print(
                f"{top:<9} {room:<12} {modules:>4} modules {lines:>7,} lines"
                f" {lines / max(modules, 1):>5.0f} a module {imports / max(lines, 1):>6.1%} imports"
            )


if __name__ == "__main__":
    main()
