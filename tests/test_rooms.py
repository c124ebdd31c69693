"""The house: every module lives in a room, and imports lead down, never up or round."""

import ast
import functools
import graphlib
from collections.abc import Iterable, Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "dfdbench"
CONTRIBUTING = PACKAGE.parent / "CONTRIBUTING.md"

#: The floor of each room; a room imports only from rooms on lower floors.
FLOORS = {
    **{"cli": 11, "report": 9, "board": 8, "evaluation": 7, "figures": 7},
    **{"building": 6, "training": 6, "audit": 6, "results": 5, "simulation": 5},
    **{"methods": 4, "rig": 4, "datasets": 4, "optics": 3, "blur": 2, "metrics": 2},
    **{"system": 1, "tables": 1},
}
#: What stands beside the rooms. All may import `errors`; none imports `__main__`, nor the face
#: that users import, which leads to rooms up to `evaluation`.
TOP_LEVEL = {"__main__": 12, "api": 10, "__init__": 10, "torch_pairs": 5}
TOP_LEVEL |= {"manifests": 0, "rows": 0, "errors": 0, "statuses": 0}


def room(module: str) -> str:
    """Return the room of a module's full name; what stands beside the rooms is its own."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else "__init__"


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def imported(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Yield what some statements import of the package."""
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import: {ast.unparse(node)}"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                yield whole if whole in MODULES else str(node.module)


@functools.cache
def arrows() -> dict[tuple[str, str], list[str]]:
    """Return the modules that lead from one room to another, by both rooms."""
    found: dict[tuple[str, str], list[str]] = {}
    for name, path in MODULES.items():
        for target in imported(ast.walk(parsed(path))):
            if target.split(".")[0] == "dfdbench" and room(target) != room(name):
                found.setdefault((room(name), room(target)), []).append(f"{name} -> {target}")
    return found


def test_every_module_lives_in_a_room() -> None:
    beside = {name for name in MODULES if name.count(".") == 1 and MODULES[name].parent == PACKAGE}
    assert {room(name) for name in beside} | {"__init__", "manifests", "rows"} == set(TOP_LEVEL)
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name[0] != "_"}
    assert folders == set(FLOORS)


def test_only_rooms_above_import_a_room() -> None:
    floors = FLOORS | TOP_LEVEL
    found = arrows().items()
    assert [where for (start, end), where in found if floors[start] <= floors[end]] == []


def test_no_circle_among_modules() -> None:
    # What is imported inside a function is no part of a circle: it is read when it is called.
    graph = {
        name: {target for target in imported(parsed(path).body) if target in MODULES} - {name}
        for name, path in MODULES.items()
    }
    tuple(graphlib.TopologicalSorter(graph).static_order())


def test_contributing_shows_this_house() -> None:
    table = CONTRIBUTING.read_text("utf-8")
    for name, floor in FLOORS.items():
        assert f"| {floor} | `{name}/` |" in table


def test_tests_mirror_the_rooms() -> None:
    tests = Path(__file__).parent
    for path in tests.rglob("test_*.py"):
        parts = path.relative_to(tests).parts
        if len(parts) > 1 and parts[0] in FLOORS:
            module = PACKAGE.joinpath(*parts[:-1], parts[-1].removeprefix("test_"))
            package = module.with_suffix("")
            assert module.is_file() or package.is_dir() or parts in BEYOND_A_MODULE, path


#: Tests of what several modules do together, each in the room where it begins.
BEYOND_A_MODULE = {
    ("building", "test_tracks.py"),
    ("cli", "test_command_line.py"),
    ("cli", "test_outputs.py"),
    ("cli", "test_sureness.py"),
    ("methods", "mrf", "test_real_images.py"),
    ("methods", "test_plain_recipe.py"),
    ("methods", "mrf", "test_solvers.py"),
    ("report", "test_browser.py"),
    ("report", "test_transfer.py"),
}
#: Modules without a test file of their own name: the file that tests them, and why it is another.
TESTED_ELSEWHERE = {
    "dfdbench": "test_public_names.py",
    # What the public functions return.
    "dfdbench.report.objects": "test_api.py",
    # What `main` tells of errors is seen from outside.
    "dfdbench.cli": "cli/test_command_line.py",
    # Of whole captures, by the verb.
    "dfdbench.building.registering": "cli/test_rig.py",
    # The half of SSIM that is compiled.
    "dfdbench.metrics.similarity": "metrics/test_scores.py",
    "dfdbench.results.environment": "cli/test_datasets.py",
    "dfdbench.system.array_files": "evaluation/test_map_files.py",
}


def has_code(path: Path) -> bool:
    """Whether a module defines something; one of a package may but gather others' names."""
    defined = (ast.FunctionDef, ast.ClassDef)
    nodes = parsed(path).body
    return path.name != "__init__.py" or any(isinstance(node, defined) for node in nodes)


def test_every_module_with_code_has_a_test_file_of_its_name() -> None:
    tests = Path(__file__).parent
    lacking = []
    for name, path in MODULES.items():
        *rooms, last = name.split(".")
        own = tests.joinpath(*rooms[1:], f"test_{last.strip('_')}.py")
        if has_code(path) and name not in TESTED_ELSEWHERE and not own.is_file():
            lacking.append(f"{name}: {own.relative_to(tests)}")
    assert not lacking
    for name, file in TESTED_ELSEWHERE.items():
        assert name in MODULES
        assert (tests / file).is_file()
