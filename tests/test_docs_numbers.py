"""Each number on a page is what a sealed result, a published table or a command says, as text."""

import functools
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import pytest

from dfdbench.blur.recipe import RECIPES
from dfdbench.board.row_file import read_row
from dfdbench.datasets.catalog import find_manifest, released_manifests
from dfdbench.datasets.dataset import Dataset
from dfdbench.methods.graph_cuts import GraphCuts
from dfdbench.methods.mrf import Energy, Quality, expansion, split
from dfdbench.metrics.metric import mean_of
from dfdbench.metrics.protocol import find_protocol
from dfdbench.metrics.scores import nmae, nrmse, ssim
from dfdbench.results.record import PairResult, Result
from dfdbench.results.wording import given_to, score_text
from tests.benchmarks.ledger import BEGIN, END
from tests.conftest import aloe_depth, aloe_pair
from tests.methods.test_graph_cuts import PROGRAM
from tests.process import python

ROOT = Path(__file__).parents[1]
METRICS = {"NRMSE ↓": "nrmse", "NMAE ↓": "nmae", "SSIM ↑": "ssim"}
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("README.md", "CONTRIBUTING.md", "docs/*.md", "leaderboard/note.md")
    for path in ROOT.glob(pattern)
)
#: Numbers that need a comparison: scores, shares in per cent, large energies.
NUMBER = re.compile(r"(?<![\w.])(?:[01]\.\d{4,5}|\d+\.\d+ %|\d,\d{3},\d{3})(?![\w.])")
#: By the mark of a block, how it is compared.
PRINTED, WRITTEN = "<!-- printed by: ", "<!-- written by docs/"
CHECKED = "<!-- checked by tests/test_readme.py"


@dataclass(frozen=True)
class Quoted:
    """A table of a page: how its head begins, and the board that it quotes."""

    page: str
    head: str
    board: str
    protocol: str
    method: str = ""

    def __str__(self) -> str:
        return f"{self.page}: {self.head}"


MIDDLEBURY = "middlebury-default-1-test"
QUOTED = [
    Quoted("docs/graph_cuts.md", "| protocol `thesis`", MIDDLEBURY, "thesis"),
    Quoted("docs/graph_cuts.md", "| method | scenes", "middlebury-default-1-all", "thesis"),
    Quoted("docs/metres.md", "| `dfdbench run --dataset dfd-indoor", "dfd-indoor-1-test", "valid"),
    Quoted("docs/training.md", "| DfD-Net / 8, the six", MIDDLEBURY, "thesis", "dfd-net"),
    Quoted("docs/training.md", "| demo test, protocol `valid`", "demo-1-test", "valid"),
]
#: Tables that a test below compares, by how their heads begin, and numbers that are no results.
COMPARED = {
    "README.md": ["| method | given |"],
    "docs/graph_cuts.md": ["| solved with | exposure |", "| solver | exposure 1"],
}
NO_RESULTS = {
    "docs/graph_cuts.md": {"0.01125", "1,139,913", "1,239,153", "0.1 %"},
    "docs/data_sets.md": {"0.01125"},
    "docs/thesis_contradictions.md": {"0.01125"},
    "docs/coverage.md": {"0.1 %"},
    "docs/python.md": {"0.0007"},
    # What tracks are defined by; `tests/blur/test_tracks.py` has those that were drawn.
    "docs/tracks.md": {"0.2 %", "0.6 %", "1.2 %", "1.69 %", "4.11 %", "22.71 %"}
    | {"0.04 %", "0.08 %", "0.16 %"},
    "docs/training.md": {"0.0005", "7,665,636"},
}


@dataclass
class Column:
    """What a column of a table holds: a metric under a protocol, or its range over scenes."""

    metric: str
    protocol: str
    is_range: bool = False


@functools.cache
def results(board: str, protocol: str) -> dict[str, Result]:
    """Return the results of a data set and split by method and parameters."""
    rows = [read_row(path) for path in (ROOT / "leaderboard/results" / board).glob("*.json")]
    return {
        key(result.method.name, result.method.parameters): result
        for row in rows
        if "clean" in row.suites
        for result in row.results
        if result.dataset.degradation == "clean" and protocol in result.protocol_names
    }


def mean(pairs: list[PairResult], protocol: str, metric: str) -> float | None:
    return mean_of(pair.score(protocol, metric) for pair in pairs)


def key(name: str, parameters: object) -> str:
    assert isinstance(parameters, dict)
    return " ".join([name, *sorted(f"{word}={value}" for word, value in parameters.items())])


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def table(quoted: Quoted) -> tuple[list[str], list[list[str]]]:
    lines = (ROOT / quoted.page).read_text("utf-8").splitlines()
    (start,) = [at for at, line in enumerate(lines) if line.startswith(quoted.head)]
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append(cells(line))
    return cells(lines[start]), rows


def columns(quoted: Quoted, head: list[str]) -> dict[int, Column]:
    """Return the columns that hold scores; a head that names a protocol goes on to the right."""
    found: dict[int, Column] = {}
    protocol, metric = quoted.protocol, ""
    for at, text in enumerate(head[1:], 1):
        if named := re.match(r"`([\w-]+)`", text):
            protocol = find_protocol(named[1]).label
        for heading, name in METRICS.items():
            if text.endswith(heading):
                metric = name
                found[at] = Column(metric, protocol)
        if text.startswith("range of"):
            found[at] = Column(metric, protocol, is_range=True)
    return found


def methods(quoted: Quoted, rows: list[list[str]]) -> Iterator[tuple[str, list[str]]]:
    """Yield the rows that name a method in code, with its name and its parameters in order."""
    name, parameters = quoted.method, dict[str, str]()
    for row in rows:
        words = re.sub(r"--param", " ", " ".join(re.findall(r"`(.+?)`", row[0]))).split()
        if not words:
            continue
        named = [word for word in words if "=" not in word]
        given = dict(word.split("=", 1) for word in words if "=" in word)
        if row[0].startswith("the same"):
            assert not named, f"{row[0]}: the same, and yet another method"
            given = parameters | given
        else:
            name, parameters = (named or [quoted.method])[-1], given
        yield key(name, given), row


def expected(result: Result, column: Column, cell: str, scenes: list[str]) -> str:
    def of(*names: str) -> float | None:
        pairs = [pair for pair in result.pairs if pair.scene in names]
        return mean(pairs, column.protocol, column.metric)

    by_scene = [score for scene in scenes if (score := of(scene)) is not None]
    over_scenes = f"{score_text(min(by_scene))} to {score_text(max(by_scene))}"
    if column.is_range:
        return over_scenes
    alone = score_text(of(*scenes))
    return f"{alone} ({over_scenes})" if "(" in cell else alone


def published(table: str, method: str, at: str) -> list[str]:
    """Return the scores that the thesis prints for a method, over all illuminations or a fold."""
    path = ROOT / f"leaderboard/published/emerson-2019-table-{table}.json"
    name, value = at.split()
    (row,) = [
        row
        for row in json.loads(path.read_text("utf-8"))["rows"]
        if row["method"] == method.lower().replace(" ", "-")
        and row["at"][name] == value
        and row["at"].get("illumination", "all") == "all"
    ]
    return [row["scores"][metric] for metric in METRICS.values()]


@pytest.mark.parametrize("quoted", QUOTED, ids=str)
def test_a_table_that_quotes_the_board_has_its_numbers(quoted: Quoted) -> None:
    head, rows = table(quoted)
    found = columns(quoted, head)
    assert found
    wrong, compared = [], 0
    for row in rows:
        if printed := re.match(r"printed, Table ([\d.]+): (.+)", row[0]):
            scores = published(printed[1], printed[2], "exposure 2")
            assert [row[at] for at, column in found.items() if not column.is_range] == scores
    for name, row in methods(quoted, rows):
        for at, column in found.items():
            result = results(quoted.board, column.protocol)[name]
            scenes = sorted({pair.scene for pair in result.pairs})
            if "scenes" in head and not row[1].isdigit():
                scenes = row[1].split(", ")
            right = expected(result, column, row[at], scenes)
            compared += 1
            if row[at] != right:
                wrong.append(f"{name}, {column.protocol}: {row[at]}, on the board {right}")
    assert not wrong
    assert compared >= 3


def test_the_readmes_table_is_what_make_demo_prints() -> None:
    quoted = Quoted("README.md", "| method | given |", "demo-1-test", "valid")
    (split,) = re.findall(r"^DEMO_SPLIT := (\w+)$", (ROOT / "Makefile").read_text("utf-8"), re.M)
    _, rows = table(quoted)
    assert [row[0] for row in rows] == ["`graph-cuts`", "`local`", "`s-transform`", "`constant`"]
    for name, given, *shown in rows:
        result = results(quoted.board, quoted.protocol)[name.strip("`")]
        pairs = [pair for pair in result.pairs if pair.scene == split]
        scores = [score_text(mean(pairs, "valid", metric)) for metric in METRICS.values()]
        assert (given, shown) == (given_to(result), scores), name


def test_the_floor_of_ssim_is_that_of_a_constant() -> None:
    demo, middlebury = (
        f"{mean(results(board, protocol)['constant'].pairs, protocol, 'ssim'):.2f}"
        for board, protocol in (("demo-1-test", "valid"), (MIDDLEBURY, "thesis"))
    )
    both = [demo, middlebury]
    floors = {"leaderboard": both, "protocols": both, "graph_cuts": [middlebury]}
    for page, expected in floors.items():
        text = " ".join((ROOT / f"docs/{page}.md").read_text("utf-8").split())
        assert re.findall(r"(?:has|has SSIM|and) (0\.\d\d) on", text) == expected, page


def test_the_list_of_data_sets_has_their_numbers_of_pairs() -> None:
    _, rows = table(Quoted("docs/data_sets.md", "| name | what | pairs", "", ""))
    listed = {name.strip("`"): int(pairs) for name, *_, pairs in rows}
    assert listed == {manifest.short: manifest.pair_count for manifest in released_manifests()}


@pytest.mark.parametrize("page", ["README.md", "docs/thesis.md"])
def test_pages_say_how_much_of_the_thesis_was_rerun(page: str) -> None:
    text = " ".join((ROOT / page).read_text("utf-8").split())
    (found,) = re.findall(r"default lighting, (\d+) of the (\d+) pairs", text)
    counts = [find_manifest(name).pair_count for name in ("middlebury-default", "middlebury")]
    assert list(map(int, found)) == counts


def blocks(page: str, mark: str) -> Iterator[tuple[str, range]]:
    """Yield what each mark names, and the lines that it vouches for."""
    lines = (ROOT / page).read_text("utf-8").splitlines()
    for at in [at for at, line in enumerate(lines) if line.startswith(mark)]:
        named = lines[at].removeprefix(mark).removesuffix(" -->")
        if mark == WRITTEN:
            yield named, range(at, lines.index("<!-- end -->", at))
        else:
            last = "```" if lines[at + 2].startswith("```") else ""
            yield named, range(at + 2, lines.index(last, at + 3))


def compared_lines(page: str) -> set[int]:
    lines = (ROOT / page).read_text("utf-8").splitlines()
    found: set[int] = set()
    for mark in (PRINTED, WRITTEN, CHECKED):
        for _, block in blocks(page, mark):
            found |= set(block)
    heads = [quoted.head for quoted in QUOTED if quoted.page == page] + COMPARED.get(page, [])
    for at, line in enumerate(lines):
        if line.startswith(tuple(heads)):
            while at < len(lines) and lines[at].startswith("|"):
                found.add(at)
                at += 1
    return found


@pytest.mark.parametrize("page", PAGES)
def test_a_number_that_nothing_compares_is_on_no_page(page: str) -> None:
    compared = compared_lines(page)
    lines = (ROOT / page).read_text("utf-8").splitlines()
    # The text may say again what a table of the page has.
    known = {number for at in compared for number in NUMBER.findall(lines[at])}
    known |= NO_RESULTS.get(page, set())
    if page == "docs/thesis_contradictions.md":
        texts = (path.read_text("utf-8") for path in ROOT.glob("leaderboard/published/*.json"))
        known |= {number for text in texts for number in NUMBER.findall(text)}
    loose = [
        f"line {at + 1}: {number}"
        for at, line in enumerate(lines)
        if at not in compared
        for number in NUMBER.findall(line)
        if number not in known
    ]
    assert not loose


@pytest.mark.parametrize("page", PAGES)
def test_no_page_has_the_times_of_one_machine(page: str) -> None:
    # But for the ledger, which says of which machine it is.
    before, _, rest = (ROOT / page).read_text("utf-8").partition(BEGIN)
    text = " ".join((before + rest.partition(END)[2]).split())
    unit = r"(?:m?s|seconds?|minutes?|hours?)\b"
    assert not re.findall(rf"Xeon|EPYC|(?:takes?|took|in) (?:some |about )?\d[\d.,]* {unit}", text)


@pytest.fixture(scope="module")
def workshop(demo_store: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder to run commands in, whose cache has the demo set."""
    folder = tmp_path_factory.mktemp("workshop")
    (folder / "cache/stores").mkdir(parents=True)
    (folder / "cache/stores/demo-1.zarr").symlink_to(str(demo_store.path))
    (folder / "leaderboard").symlink_to(ROOT / "leaderboard")
    return folder


def output_of(command: str, folder: Path) -> str:
    program, *words = command.split()
    if program == "cat":
        return (folder / words[0]).read_text("utf-8")
    # The scripts of docs/ are named as in a clone.
    script = ["-m", "dfdbench"] if program == "dfdbench" else [str(ROOT / words.pop(0))]
    places = {"DFDBENCH_CACHE": str(folder / "cache"), "PYTHONPATH": str(ROOT)}
    done = python(*script, *words, cwd=folder, **places)
    assert done.returncode in (0, 1), done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "commands", "lines"),
    [(page, *block) for page in PAGES for block in blocks(page, PRINTED)],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_block_is_what_its_command_prints(
    page: str, commands: str, lines: range, workshop: Path, request: pytest.FixtureRequest
) -> None:
    if "middlebury" in commands or "SHARED" in commands:
        shared = str(request.getfixturevalue("shared_data"))
        commands = commands.replace("SHARED", shared)
        if not (workshop / "cache/stores/middlebury-default-1.zarr").exists():
            build = f"dfdbench build middlebury-default --source {shared}/middlebury"
            output_of(build, workshop)
    if "reduce" in commands:
        pytest.importorskip("torch", reason="needs the extra nets")
    out = [output_of(command, workshop) for command in commands.split(" && ")][-1]
    printed = {" ".join(line.split()) for line in out.splitlines()}
    text = (ROOT / page).read_text("utf-8").splitlines()
    shown = [" ".join(text[at].split()) for at in lines if text[at] != "```"]
    assert shown
    assert [line for line in shown if line not in printed] == []


@pytest.mark.slow
@pytest.mark.parametrize("exposure", [1, 2])
def test_the_scores_and_energies_of_aloe_are_what_the_solvers_give(
    exposure: int, shared_data: Path, aloe: Callable[[int], Energy]
) -> None:
    infocus, defocus = aloe_pair(shared_data, exposure)
    depth = aloe_depth(shared_data)
    found = {}
    for recipe in ("text", "published"):
        method = GraphCuts(RECIPES[recipe], published_offset=True)
        scores = [metric(depth, method(infocus, defocus)) for metric in (nrmse, nmae, ssim)]
        found[recipe] = list(map(score_text, scores))
    page = "docs/graph_cuts.md"
    step = {f"{RECIPES[name].sigma_step:g} (`{name}`)": name for name in ("text", "published")}
    compared = 0
    at = ["", ""]
    for row in table(Quoted(page, "| solved with | exposure | |", "", ""))[1]:
        at = [cell or before for cell, before in zip(row[:2], at, strict=True)]
        if at[1] != str(exposure):
            continue
        recipe = step[at[0]]
        if row[2] == "program":
            right = [score_text(score) for score in PROGRAM[recipe, exposure]]
        else:
            right = found[recipe]
        assert row[3:] == right, row
        compared += 1
    assert compared == 4
    energy = aloe(exposure)
    qualities = get_args(Quality)
    solved = {f"`split`, quality `{quality}`": split(energy, quality) for quality in qualities}
    solved["`expansion`"] = expansion(energy)
    # The least energies known: of the author's program, and of a long run of several solvers.
    known = {1: 1_139_913, 2: 1_239_127}[exposure]
    for name, most in zip(solved, (1.006, 1.001, 1.0002, 1.0006), strict=True):
        assert known * 0.9995 < solved[name].energy < known * most, name
    _, rows = table(Quoted(page, "| solver | exposure 1", "", ""))
    reached = {name: f"{solution.energy:,}" for name, solution in solved.items()}
    assert {row[0]: row[exposure] for row in rows} == reached
