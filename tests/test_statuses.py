"""Every status that the command line ends with is told."""

import ast
from pathlib import Path

from dfdbench import statuses

ROOT = Path(__file__).parents[1]


def test_the_table_tells_each_status_that_the_code_ends_with() -> None:
    ended = set()
    for path in (ROOT / "dfdbench/__main__.py", *(ROOT / "dfdbench/cli").glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("exit", "Exit")):
                ended |= {getattr(statuses, ast.unparse(status)) for status in node.args}
    # Nothing else is said where all is done.
    assert ended == set(statuses.STATUSES)


def test_the_page_for_scripts_shows_the_table() -> None:
    page = (ROOT / "docs/scripts.md").read_text("utf-8")
    rows = [line for line in page.splitlines() if line[:3].strip("| ").isdigit()]
    assert rows == [f"| {status} | {means} |" for status, means in statuses.STATUSES.items()]
