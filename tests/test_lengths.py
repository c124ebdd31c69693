"""What is long says why: a module of more than 500 lines, a function of more than 40."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
MOST_LINES, MOST_STATEMENT_LINES = 500, 40

_KERNEL = "compiled by numba: what it calls would be handed a dozen arrays and counters"
REASONS = {
    "dfdbench/api.py": "every public function, each with its docstring",
    "dfdbench/audit/splits.py": "proposals, and the tables and files that show them",
    "dfdbench/blur/occlusion.py:_composite": _KERNEL,
    "dfdbench/building/folder_facts.py": "what photographs, depth maps and tables tell of one set",
    "dfdbench/methods/data_cost.py:_fill": _KERNEL,
    "dfdbench/methods/mrf/maxflow.py:_grow_and_augment": _KERNEL,
    "dfdbench/methods/mrf/moves.py:_propose": _KERNEL,
    "dfdbench/methods/rounded_graph_cuts.py:_misfits": _KERNEL,
    "dfdbench/methods/shape_from_focus.py:_peaks": _KERNEL,
    "dfdbench/metrics/similarity.py:mean_similarity": _KERNEL,
    "dfdbench/simulation/rooms.py": "all that a room may hold, a few lines each",
    "dfdbench/simulation/tracing.py": "numba notices a change only in a function's own file",
    "dfdbench/simulation/tracing.py:list_tiles": _KERNEL,
}


def _long() -> set[str]:
    found = set()
    for path in sorted((ROOT / "dfdbench").rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        text = path.read_text("utf-8")
        if len(text.splitlines()) > MOST_LINES:
            found.add(name)
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef) and _lines(node) > MOST_STATEMENT_LINES:
                found.add(f"{name}:{node.name}")
    return found


def _lines(function: ast.FunctionDef) -> int:
    # Neither the docstring nor the signature, which is a verb's list of options.
    body = function.body[1:] if ast.get_docstring(function) is not None else function.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def test_what_is_long_has_a_reason() -> None:
    assert _long() == set(REASONS)
